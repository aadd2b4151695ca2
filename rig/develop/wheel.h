/* What a colour wheel does to exposures that are no whole number of its turns. */
#ifndef RIG_DEVELOP_WHEEL_H
#define RIG_DEVELOP_WHEEL_H

/* How far one colour's light is expected to be off (root mean square, relative) in an exposure of `turns` that begins
 * anywhere in the turn of a wheel of three equal colours; 0 for whole turns. */
double wheel_colour_error(double turns);

#endif
