/* A controller in the interrupt of a timer that fires every RDPI_CONTROLLER_TS_S seconds.
 *
 * Fill in the three board_* functions. Displacements are micrometres and commands volts; with
 * RDPI_PRECISION 31 both are fractions of their scales, as README.md says. */
#include "@NAME@.h"

rdpi_real board_read_um(void);
void board_write_V(rdpi_real command_V);
/* reference_um[0] is r(k), the others what comes after it. */
void board_reference_um(rdpi_real reference_um[1 + RDPI_CONTROLLER_PREVIEW]);

void timer_begin(void);
void timer_interrupt(void);

static rdpi_controller_state state;
static rdpi_real next_V = RDPI_CONTROLLER_REST_V;
static uint8_t waits;

/* Once, before the timer is started. */
void timer_begin(void)
{
    rdpi_real reference_um[1 + RDPI_CONTROLLER_PREVIEW];

    board_reference_um(reference_um);
    rdpi_controller_init(&state, &rdpi_controller_default, reference_um[0]);
    next_V = RDPI_CONTROLLER_REST_V;
    waits = 0;
}

void timer_interrupt(void)
{
    rdpi_real reference_um[1 + RDPI_CONTROLLER_PREVIEW];

    /* First what was computed a sample ago: it is written at the same instant, however long a step takes. */
    board_write_V(next_V);
    if (waits) {
        rdpi_controller_acknowledge(&state, next_V);
    }
    board_reference_um(reference_um);
    next_V = rdpi_controller_step(&state, &rdpi_controller_default, reference_um[0], &reference_um[1], board_read_um());
    waits = 1;
}
