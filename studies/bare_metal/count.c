/* Runs the vectors of a folder of generated code, and counts the instructions of a step by the system timer.
 *
 * The emulator's clock goes by instructions, so that ticks are exact. Prints the ticks of a loop of
 * 2 x 1000 instructions; those of all steps, the most that one took, and how many steps there are; the
 * largest difference from what is expected, in 1e-12 of RDPI_SPAN; and the bytes of an instance. */
#include <stdint.h>
#include <stdio.h>

#ifdef RDPI_COUNT_PLANT
#include "rdpi_plant.h"
#else
#include "rdpi_controller.h"
#endif
#include "rdpi_vectors.h"

#define SYSTEM_TIMER ((volatile uint32_t *)0xE000E010u)
#define LOWEST_24 0xFFFFFFu

/* What is done for a step stays before it: the compiler moves nothing of it behind a reading of the timer. */
#define DONE() __asm__ volatile("" : : : "memory")

static uint32_t ticks_since(uint32_t before)
{
    return (before - SYSTEM_TIMER[2]) & LOWEST_24;
}

static uint32_t loop(uint32_t rounds)
{
    const uint32_t before = SYSTEM_TIMER[2];

    __asm__ volatile(".syntax unified\n1:\n\tsubs %0, %0, #1\n\tbne 1b" : "+l"(rounds) : : "cc");
    return ticks_since(before);
}

static uint32_t empty(void)
{
    const uint32_t before = SYSTEM_TIMER[2];

    return ticks_since(before);
}

int main(void)
{
#ifdef RDPI_COUNT_PLANT
    static rdpi_plant_state state;
    static volatile rdpi_real given;
#else
    static rdpi_controller_state state;
    static rdpi_real ahead[RDPI_CONTROLLER_PREVIEW];
    static volatile rdpi_real reference, measured;
#endif
    const uint32_t start = (SYSTEM_TIMER[1] = LOWEST_24, SYSTEM_TIMER[2] = 0u, SYSTEM_TIMER[0] = 5u, 0u);
    const uint32_t none = empty();
    uint32_t longest = start;
    uint64_t all = 0u;
    double worst = 0.0;

    printf("loop %lu\n", (unsigned long)(loop(1001u) - loop(1u)));
#ifdef RDPI_COUNT_PLANT
    rdpi_plant_init(&state, &rdpi_plant_default);
#else
    rdpi_controller_init(&state, &rdpi_controller_default,
                         rdpi_controller_from_um((double)rdpi_vector_reference_um[0]));
#endif
    for (uint32_t k = 0u; k < RDPI_VECTORS; ++k) {
        uint32_t before, taken;
        double away;
#ifdef RDPI_COUNT_PLANT
        rdpi_real found;

        given = (rdpi_real)rdpi_vector_command_V[k];
        DONE();
        before = SYSTEM_TIMER[2];
        found = rdpi_plant_step(&state, &rdpi_plant_default, given);
        taken = ticks_since(before);
        DONE();
        away = (double)found - (double)rdpi_vector_expected_um[k];
#else
        rdpi_real found;

        reference = rdpi_controller_from_um((double)rdpi_vector_reference_um[k]);
        measured = rdpi_controller_from_um((double)rdpi_vector_measured_um[k]);
        for (uint32_t j = 0u; j < RDPI_CONTROLLER_PREVIEW; ++j) {
            ahead[j] = rdpi_controller_from_um((double)rdpi_vector_reference_um[k + 1u + j]);
        }
        DONE();
        before = SYSTEM_TIMER[2];
        found = rdpi_controller_step(&state, &rdpi_controller_default, reference, ahead, measured);
        rdpi_controller_acknowledge(&state, found);
        taken = ticks_since(before);
        DONE();
        away = rdpi_controller_to_V(found) - (double)rdpi_vector_expected_V[k];
#endif
        taken -= none;
        all += taken;
        longest = taken > longest ? taken : longest;
        away = (away < 0.0) ? -away : away;
        worst = (away > worst) ? away : worst;
    }
    worst = worst / RDPI_SPAN * 1e12;
    printf("steps %lu %lu %lu\n", (unsigned long)all, (unsigned long)longest, (unsigned long)RDPI_VECTORS);
    printf("away %lu\n", (unsigned long)(worst < 4e9 ? worst : 4e9));
    printf("state %lu\n", (unsigned long)sizeof state);
    return 0;
}
