/* batch IN OUT LANES SAMPLES WILD: every lane from rest; doubles in, doubles out. */
#include <stdio.h>
#include <stdlib.h>

#include "rdpi_plant.h"

static rdpi_plant_state state;

int main(int count, char **words)
{
    const rdpi_plant_parameters *p = &rdpi_plant_default;
    FILE *in;
    FILE *out;
    long lanes;
    long samples;

    if (count != 6) {
        return 2;
    }
    in = fopen(words[1], "rb");
    out = fopen(words[2], "wb");
    lanes = atol(words[3]);
    samples = atol(words[4]);
    if (!in || !out) {
        return 3;
    }
    for (long lane = 0; lane < lanes; ++lane) {
        rdpi_plant_init(&state, p);
        for (long k = 0; k < samples; ++k) {
            double value;

            if (fread(&value, sizeof value, 1, in) != 1) {
                return 4;
            }
            value = rdpi_plant_to_um(rdpi_plant_step(&state, p, rdpi_plant_from_V(value)));
            if (fwrite(&value, sizeof value, 1, out) != 1) {
                return 5;
            }
        }
    }
    fclose(in);
    return fclose(out) ? 6 : 0;
}
