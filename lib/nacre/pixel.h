/* The number formats in which nacre's files keep their values. */
#ifndef NACRE_PIXEL_H
#define NACRE_PIXEL_H

enum nacre_pixel {
    NACRE_UINT,  /* 32-bit unsigned integer */
    NACRE_HALF,  /* 16-bit float: 11 significant bits, nothing below 6e-8, 65504 at most */
    NACRE_FLOAT, /* 32-bit float */
};

#endif
