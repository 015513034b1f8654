/* The model as an FMU for co-simulation, FMI @VERSION@: see rdpi_fmu.h. */
#include "rdpi_@F@.h"

#include "rdpi_fmu.h"

typedef struct {
    rdpi_fmu_memory memory;
@IF_TWO@
    fmi2CallbackFunctions callbacks;
    char *name;
@END_TWO@
@IF_THREE@
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
@END_THREE@
} instance_t;

@IF_TWO@
static void report(const fmi2CallbackFunctions *callbacks, const char *name, const char *function,
                   const char *what)
{
    char text[RDPI_FMU_MESSAGE + 80];
    size_t i;
    if (callbacks == NULL || callbacks->logger == NULL) {
        return;
    }
    (void)snprintf(text, sizeof text, "%s: %s", function, what);
    for (i = 0; text[i] != '\0'; i++) { /* the message is a format: nothing in it may act as one */
        if (text[i] == '%') {
            text[i] = ' ';
        }
    }
    callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError", text);
}
@END_TWO@
@IF_THREE@
static void report(fmi3LogMessageCallback log, fmi3InstanceEnvironment environment,
                   const char *function, const char *what)
{
    char text[RDPI_FMU_MESSAGE + 80];
    if (log != NULL) {
        (void)snprintf(text, sizeof text, "%s: %s", function, what);
        log(environment, fmi3Error, "logStatusError", text);
    }
}
@END_THREE@

static @F@Status refuse(const instance_t *self, const char *function, const char *what)
{
    if (self != NULL) {
@IF_TWO@
        report(&self->callbacks, self->name, function, what);
@END_TWO@
@IF_THREE@
        report(self->log, self->environment, function, what);
@END_THREE@
    }
    return @F@Error;
}

/* Of variables of a kind that the model has none of. */
static @F@Status none_of(const instance_t *self, size_t count, const char *function)
{
    return self != NULL && count == 0u ? @F@OK
                                       : refuse(self, function, "the model has none of these");
}

@IF_TWO@
const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

@END_TWO@
const char *@F@GetVersion(void)
{
    return @F@Version;
}

/* There are errors only, and they are always told. */
@F@Status @F@SetDebugLogging(@HANDLE@ c, @F@Boolean loggingOn, size_t nCategories,
                               const @F@String categories[])
{
    (void)loggingOn;
    (void)nCategories;
    (void)categories;
    return c != NULL ? @F@OK : @F@Error;
}

@IF_TWO@
fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    instance_t *self;
    const char *name = instanceName != NULL ? instanceName : "";
    (void)fmuResourceLocation;
    (void)visible;
    (void)loggingOn;
    if (fmuType != fmi2CoSimulation) {
        report(functions, name, __func__, "this FMU is for co-simulation");
        return NULL;
    }
    if (fmuGUID == NULL || strcmp(fmuGUID, RDPI_FMU_TOKEN) != 0) {
        report(functions, name, __func__, "the GUID is not that of this model's description");
        return NULL;
    }
    self = (instance_t *)calloc(1, sizeof *self);
    if (self != NULL) {
        self->name = (char *)malloc(strlen(name) + 1u);
    }
    if (self == NULL || self->name == NULL) {
        report(functions, name, __func__, "no memory is left");
        free(self);
        return NULL;
    }
    memcpy(self->name, name, strlen(name) + 1u);
    if (functions != NULL) {
        self->callbacks = *functions;
    }
@END_TWO@
@IF_THREE@
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    instance_t *self;
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)intermediateUpdate;
    if (instantiationToken == NULL || strcmp(instantiationToken, RDPI_FMU_TOKEN) != 0) {
        report(logMessage, instanceEnvironment, __func__,
               "the token is not that of this model's description");
        return NULL;
    }
    if (eventModeUsed || nRequiredIntermediateVariables > 0u) {
        report(logMessage, instanceEnvironment, __func__,
               "this FMU has neither an event mode nor intermediate updates");
        return NULL;
    }
    self = (instance_t *)calloc(1, sizeof *self);
    if (self == NULL) {
        report(logMessage, instanceEnvironment, __func__, "no memory is left");
        return NULL;
    }
    self->environment = instanceEnvironment;
    self->log = logMessage;
@END_THREE@
    rdpi_fmu_reset(&self->memory);
    return self;
}

void @F@FreeInstance(@HANDLE@ c)
{
@IF_TWO@
    if (c != NULL) {
        free(((instance_t *)c)->name);
    }
@END_TWO@
    free(c);
}

static @F@Status change(@HANDLE@ c, rdpi_fmu_mode from, rdpi_fmu_mode to, const char *function)
{
    instance_t *self = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE];
    if (self == NULL) {
        return @F@Error;
    }
    if (!rdpi_fmu_is(&self->memory, from, message)) {
        return refuse(self, function, message);
    }
    self->memory.mode = (uint8_t)to;
    return @F@OK;
}

@F@Status @F@@BEGIN@(@HANDLE@ c, @F@Boolean toleranceDefined, @F@@REAL@ tolerance,
                     @F@@REAL@ startTime, @F@Boolean stopTimeDefined, @F@@REAL@ stopTime)
{
    instance_t *self = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE];
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (self == NULL) {
        return @F@Error;
    }
    if (!rdpi_fmu_is(&self->memory, RDPI_FMU_INSTANTIATED, message)
        || !rdpi_fmu_begin(&self->memory, startTime, message)) {
        return refuse(self, __func__, message);
    }
@IF_THREE@
    self->memory.mode = (uint8_t)RDPI_FMU_INITIALIZING;
@END_THREE@
    return @F@OK;
}

@IF_TWO@
fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return change(c, RDPI_FMU_INSTANTIATED, RDPI_FMU_INITIALIZING, __func__);
}

@END_TWO@
@F@Status @F@ExitInitializationMode(@HANDLE@ c)
{
    return change(c, RDPI_FMU_INITIALIZING, RDPI_FMU_STEPPING, __func__);
}

@F@Status @F@Terminate(@HANDLE@ c)
{
    return change(c, RDPI_FMU_STEPPING, RDPI_FMU_TERMINATED, __func__);
}

@F@Status @F@Reset(@HANDLE@ c)
{
    if (c == NULL) {
        return @F@Error;
    }
    rdpi_fmu_reset(&((instance_t *)c)->memory);
    return @F@OK;
}

@IF_TWO@
#define UNFIT(self) ((self) == NULL || (nvr > 0u && (vr == NULL || value == NULL)))
#define UNFIT_TEXT "an argument is missing"
@END_TWO@
@IF_THREE@
#define UNFIT(self) \
    ((self) == NULL || nValues != nvr || (nValues > 0u && (vr == NULL || value == NULL)))
#define UNFIT_TEXT "an argument is missing, or there is not one value for each"
@END_THREE@

@F@Status @F@Get@REAL@(@HANDLE@ c, const @F@ValueReference vr[], size_t nvr, @F@@REAL@ value[]@COUNT@)
{
    const instance_t *self = (const instance_t *)c;
    size_t i;
    if (UNFIT(self)) {
        return refuse(self, __func__, UNFIT_TEXT);
    }
    for (i = 0; i < nvr; i++) {
        if (!rdpi_fmu_get(&self->memory, vr[i], &value[i])) {
            return refuse(self, __func__, "a value reference is of no number");
        }
    }
    return @F@OK;
}

@F@Status @F@Set@REAL@(@HANDLE@ c, const @F@ValueReference vr[], size_t nvr, const @F@@REAL@ value[]@COUNT@)
{
    instance_t *self = (instance_t *)c;
    size_t i;
    if (UNFIT(self)) {
        return refuse(self, __func__, UNFIT_TEXT);
    }
    for (i = 0; i < nvr; i++) {
        if (!rdpi_fmu_set(&self->memory, vr[i], value[i])) {
            return refuse(self, __func__, "only inputs can be set, and before the end");
        }
    }
    return @F@OK;
}

@F@Status @F@GetBoolean(@HANDLE@ c, const @F@ValueReference vr[], size_t nvr, @F@Boolean value[]@COUNT@)
{
    const instance_t *self = (const instance_t *)c;
    size_t i;
    if (UNFIT(self)) {
        return refuse(self, __func__, UNFIT_TEXT);
    }
    for (i = 0; i < nvr; i++) {
        bool set = false;
        if (!rdpi_fmu_flag(self->memory.flags, vr[i] - RDPI_FMU_FIRST_FLAG, &set)) {
            return refuse(self, __func__, "a value reference is of no flag");
        }
        value[i] = set ? @F@True : @F@False;
    }
    return @F@OK;
}

@F@Status @F@Get@STATE@(@HANDLE@ c, @F@@STATE@ *state)
{
    const instance_t *self = (const instance_t *)c;
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    if (self == NULL || state == NULL || !rdpi_fmu_keep(&self->memory, state, message)) {
        return refuse(self, __func__, message);
    }
    return @F@OK;
}

@F@Status @F@Set@STATE@(@HANDLE@ c, @F@@STATE@ state)
{
    instance_t *self = (instance_t *)c;
    if (self == NULL || state == NULL) {
        return refuse(self, __func__, "an argument is missing");
    }
    memcpy(&self->memory, state, sizeof self->memory);
    return @F@OK;
}

@F@Status @F@Free@STATE@(@HANDLE@ c, @F@@STATE@ *state)
{
    if (c == NULL) {
        return @F@Error;
    }
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return @F@OK;
}

@F@Status @F@Serialized@STATE@Size(@HANDLE@ c, @F@@STATE@ state, size_t *size)
{
    if (c == NULL || state == NULL || size == NULL) {
        return refuse((const instance_t *)c, __func__, "an argument is missing");
    }
    *size = RDPI_FMU_BYTES;
    return @F@OK;
}

@F@Status @F@Serialize@STATE@(@HANDLE@ c, @F@@STATE@ state, @F@Byte bytes[], size_t size)
{
    if (c == NULL || state == NULL || bytes == NULL || size < RDPI_FMU_BYTES) {
        return refuse((const instance_t *)c, __func__, "an argument is missing, or too small");
    }
    rdpi_fmu_write((const rdpi_fmu_memory *)state, bytes);
    return @F@OK;
}

@F@Status @F@@READ@@STATE@(@HANDLE@ c, const @F@Byte bytes[], size_t size, @F@@STATE@ *state)
{
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    if (c == NULL || state == NULL || !rdpi_fmu_read(bytes, size, state, message)) {
        return refuse((const instance_t *)c, __func__, message);
    }
    return @F@OK;
}

@IF_TWO@
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint,
                      fmi2Real communicationStepSize, fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    instance_t *self = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE];
    (void)noSetFMUStatePriorToCurrentPoint;
    if (self == NULL) {
        return fmi2Error;
    }
    if (!rdpi_fmu_run(&self->memory, currentCommunicationPoint, communicationStepSize, message)) {
        return refuse(self, __func__, message);
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    const instance_t *self = (const instance_t *)c;
    if (self == NULL || value == NULL) {
        return refuse(self, __func__, "an argument is missing");
    }
    if (s != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = self->memory.time_s;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    if (c == NULL || value == NULL) {
        return refuse((const instance_t *)c, __func__, "an argument is missing");
    }
    if (s != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = fmi2False;
    return fmi2OK;
}
@END_TWO@
@IF_THREE@
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    instance_t *self = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    bool done;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (self == NULL || eventHandlingNeeded == NULL || terminateSimulation == NULL
        || earlyReturn == NULL || lastSuccessfulTime == NULL) {
        return refuse(self, __func__, message);
    }
    done = rdpi_fmu_run(&self->memory, currentCommunicationPoint, communicationStepSize, message);
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = fmi3False;
    *earlyReturn = fmi3False;
    *lastSuccessfulTime = self->memory.time_s;
    return done ? fmi3OK : refuse(self, __func__, message);
}
@END_THREE@

/* What the model has not. */

@REFUSALS@
