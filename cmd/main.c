/* The program `nacre`: its list of verbs. */
#include "cmd/verbs.h"

#include <signal.h>

int main(int argc, char **argv)
{
    static const struct verb *const verbs[] = {
        &verb_scan,   &verb_doctor,  &verb_start,   &verb_status,   &verb_pause,
        &verb_resume, &verb_cancel,  &verb_confirm, &verb_simulate, &verb_develop,
        &verb_factor, &verb_error,   &verb_render,  &verb_bake,     &verb_tradeoff,
        &verb_report, &verb_devices, &verb_plan,    &verb_view,     NULL};
    static const struct program program = {
        .name = "nacre",
        .version = NACRE_VERSION,
        .summary = "measures, factors and renders heterogeneous translucent materials",
        .verbs = verbs,
    };
    /* A limit on the size of files is told as an error of writing, like a full disk. */
    (void)signal(SIGXFSZ, SIG_IGN);
    return options_run(&program, argc, argv);
}
