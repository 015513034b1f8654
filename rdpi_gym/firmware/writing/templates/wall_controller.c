@REACH@
@IF_REAL@
/* Whether x is no farther from a place than that; NaN is. */
static int32_t rdpi_is_near(rdpi_real x, rdpi_real place, rdpi_real far)
{
    return (((x - place) <= far) && ((place - x) <= far)) ? 1 : 0;
}

static int32_t rdpi_is_usable(rdpi_real um)
{
    return rdpi_is_near(um, @CENTRE@, @FAR@);
}
@END_REAL@

void rdpi_controller_init(rdpi_controller_state *s, const rdpi_controller_parameters *p, rdpi_real reference_um)
{
@FIRST@
    (void)p;
@UNUSED_FIRST@
    s->flags = 0u;
@IF_REAL@
    if (rdpi_is_usable(reference_um) == 0) {
@IF_FIRST@
        first_um = @CENTRE@;
@END_FIRST@
        s->flags = (uint8_t)RDPI_OUT_OF_RANGE;
    }
@END_REAL@
    rdpi_rest(&s->memory[0]@REST_ARGUMENT@);
@BEGIN@
    s->memory[1] = s->memory[0];
    s->applied_V = RDPI_CONTROLLER_REST_V;
    s->current = 0u;
    s->pending = 0u;
}

rdpi_real rdpi_controller_step(rdpi_controller_state *s, const rdpi_controller_parameters *p, rdpi_real reference_um,
                               const rdpi_real preview_um[RDPI_CONTROLLER_PREVIEW], rdpi_real measured_um)
{
    rdpi_controller_memory *spare = &s->memory[(s->current == 0u) ? 1 : 0];
    rdpi_real command_V;
    unsigned flags = 0u;
@IF_REAL@
    int32_t usable = rdpi_is_usable(reference_um);

@CHECK_MEASURED@
    for (int32_t i = 0; i < RDPI_CONTROLLER_PREVIEW; ++i) {
        if (rdpi_is_usable(preview_um[i]) == 0) {
            usable = 0;
        }
    }
    if (usable == 0) {
        s->pending = 0u;
        s->flags = (uint8_t)RDPI_OUT_OF_RANGE;
        return s->applied_V;
    }
@END_REAL@
    *spare = s->memory[s->current];
    command_V = rdpi_run(p, spare, reference_um, preview_um, measured_um, s->applied_V);
@IF_REAL@
    if (rdpi_is_near(command_V, RDPI_CONTROLLER_REST_V, @LARGEST@) == 0) {
        s->pending = 0u;
        s->flags = (uint8_t)RDPI_OUT_OF_RANGE;
        return s->applied_V;
    }
@END_REAL@
    if (command_V <= RDPI_CONTROLLER_LOW_V) {
        command_V = RDPI_CONTROLLER_LOW_V;
        flags |= RDPI_CLAMPED;
    }
    if (command_V >= RDPI_CONTROLLER_HIGH_V) {
        command_V = RDPI_CONTROLLER_HIGH_V;
        flags |= RDPI_CLAMPED;
    }
    if ((preview_um[0] < RDPI_LOWEST_UM) || (preview_um[0] > RDPI_HIGHEST_UM)) {
        flags |= RDPI_SATURATED;
    }
    s->flags = (uint8_t)flags;
    s->pending = 1u;
    return command_V;
}

void rdpi_controller_acknowledge(rdpi_controller_state *s, rdpi_real written_V)
{
    rdpi_real applied_V = written_V;

    if (written_V < RDPI_CONTROLLER_LOW_V) {
        applied_V = RDPI_CONTROLLER_LOW_V;
    }
    if (written_V > RDPI_CONTROLLER_HIGH_V) {
        applied_V = RDPI_CONTROLLER_HIGH_V;
    }
@IF_REAL@
    if (rdpi_is_near(written_V, RDPI_CONTROLLER_REST_V, @LARGEST@) == 0) {
        s->pending = 0u; /* nobody knows what was written */
    }
@END_REAL@
    if (s->pending != 0u) {
        s->applied_V = applied_V;
        s->current = (s->current == 0u) ? 1u : 0u;
        s->pending = 0u;
    }
}

uint8_t rdpi_controller_flags(const rdpi_controller_state *s)
{
    return s->flags;
}
