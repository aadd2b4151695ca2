/* Writes a small grey material of one kernel, for effects_cost.py. Usage: make_material FILE */
#include "stand.h"

#include <stdio.h>
#include <unity.h>

void setUp(void)
{
}
void tearDown(void)
{
}

int main(int count, char **arguments)
{
    struct nacre_error error = {0};
    struct nacre_material material = stand_even_material(12, 5, 1.2, 0.6);
    int status = count == 2 ? nacre_material_write(arguments[1], &material, &error) : NACRE_FAILED;
    if (status != NACRE_OK) {
        (void)fprintf(stderr, "usage: %s FILE; %s\n", arguments[0], error.text);
    }
    nacre_material_finish(&material);
    return status == NACRE_OK ? 0 : 1;
}
