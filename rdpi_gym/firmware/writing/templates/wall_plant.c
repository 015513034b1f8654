/* Whether x is no farther from a place than that; NaN is. */
static int32_t rdpi_is_near(rdpi_real x, rdpi_real place, rdpi_real far)
{
    return (((x - place) <= far) && ((place - x) <= far)) ? 1 : 0;
}

void rdpi_plant_init(rdpi_plant_state *s, const rdpi_plant_parameters *p)
{
    (void)p;
    rdpi_rest(&s->memory);
    s->command_V = RDPI_PLANT_REST_V;
    s->displacement_um = RDPI_C(0.0);
    s->flags = 0u;
}

rdpi_real rdpi_plant_step(rdpi_plant_state *s, const rdpi_plant_parameters *p, rdpi_real command_V)
{
    rdpi_real displacement_um;
    unsigned flags = 0u;

    if (rdpi_is_near(command_V, @MIDDLE@, @FAR@) != 0) {
        s->command_V = command_V;
    } else {
        flags |= RDPI_OUT_OF_RANGE;
    }
    if ((s->command_V < RDPI_PLANT_LOW_V) || (s->command_V > RDPI_PLANT_HIGH_V)) {
        flags |= RDPI_CLAMPED;
    }
    displacement_um = rdpi_run(p, &s->memory, s->command_V);
    if (rdpi_is_near(displacement_um, RDPI_C(0.0), @LARGEST@) != 0) {
        s->displacement_um = displacement_um;
    } else {
        flags |= RDPI_OUT_OF_RANGE;
    }
    s->flags = (uint8_t)flags;
    return s->displacement_um;
}

uint8_t rdpi_plant_flags(const rdpi_plant_state *s)
{
    return s->flags;
}
