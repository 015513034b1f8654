/* A plant in the interrupt of a timer that fires every RDPI_PLANT_TS_S seconds: hardware in the loop.
 *
 * Fill in the two board_* functions: they stand for the amplifier's input and the sensor's output. */
#include "@NAME@.h"

rdpi_real board_read_V(void);
void board_write_um(rdpi_real displacement_um);

void timer_begin(void);
void timer_interrupt(void);

static rdpi_plant_state state;

/* Once, before the timer is started. */
void timer_begin(void)
{
    rdpi_plant_init(&state, &rdpi_plant_default);
}

void timer_interrupt(void)
{
    board_write_um(rdpi_plant_step(&state, &rdpi_plant_default, board_read_V()));
}
