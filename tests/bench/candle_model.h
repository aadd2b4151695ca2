/* A factored material of the size of the paper's candle, made by rule. */
#ifndef TESTS_BENCH_CANDLE_MODEL_H
#define TESTS_BENCH_CANDLE_MODEL_H

#include "nacre/material.h"

/* 212 x 154 surface points of 0.934 mm, window 49, 12 terms, 100 hard clusters, RGB: red wax that scatters little in
 * yellow wax that scatters much, cracked by noise. Ends the program where memory runs out; nacre_material_finish it. */
struct nacre_material candle_model(void);

#endif
