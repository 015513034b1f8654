/* The model as an FMU for co-simulation, FMI 2.0: see rdpi_fmu.h. */
#include "rdpi_fmi2.h"

#include "rdpi_fmu.h"

typedef struct {
    rdpi_fmu_memory memory;
    fmi2CallbackFunctions callbacks;
    char *name;
} instance_t;

static void report(const fmi2CallbackFunctions *callbacks, const char *name, const char *function,
                   const char *what)
{
    char text[RDPI_FMU_MESSAGE + 60];
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

static fmi2Status refuse(const instance_t *instance, const char *function, const char *what)
{
    if (instance != NULL) {
        report(&instance->callbacks, instance->name, function, what);
    }
    return fmi2Error;
}

/* For what the model has not: nothing may be asked of it, and asking for nothing is no error. */
static fmi2Status none_of(const instance_t *instance, size_t count, const char *function)
{
    return instance != NULL && count == 0u ? fmi2OK
                                           : refuse(instance, function, "the model has none of these");
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* There are errors only, and they are always told. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    (void)loggingOn;
    (void)nCategories;
    (void)categories;
    return c != NULL ? fmi2OK : fmi2Error;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    instance_t *instance;
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
    instance = (instance_t *)calloc(1, sizeof *instance);
    if (instance != NULL) {
        instance->name = (char *)malloc(strlen(name) + 1u);
    }
    if (instance == NULL || instance->name == NULL) {
        report(functions, name, __func__, "no memory is left");
        free(instance);
        return NULL;
    }
    memcpy(instance->name, name, strlen(name) + 1u);
    if (functions != NULL) {
        instance->callbacks = *functions;
    }
    rdpi_fmu_reset(&instance->memory);
    return instance;
}

void fmi2FreeInstance(fmi2Component c)
{
    instance_t *instance = (instance_t *)c;
    if (instance != NULL) {
        free(instance->name);
        free(instance);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    instance_t *instance = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE];
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (instance == NULL) {
        return fmi2Error;
    }
    if (!rdpi_fmu_is(&instance->memory, RDPI_FMU_INSTANTIATED, message)
        || !rdpi_fmu_begin(&instance->memory, startTime, message)) {
        return refuse(instance, __func__, message);
    }
    return fmi2OK;
}

static fmi2Status change(fmi2Component c, rdpi_fmu_mode from, rdpi_fmu_mode to, const char *function)
{
    instance_t *instance = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE];
    if (instance == NULL) {
        return fmi2Error;
    }
    if (!rdpi_fmu_is(&instance->memory, from, message)) {
        return refuse(instance, function, message);
    }
    instance->memory.mode = (uint8_t)to;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return change(c, RDPI_FMU_INSTANTIATED, RDPI_FMU_INITIALIZING, __func__);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return change(c, RDPI_FMU_INITIALIZING, RDPI_FMU_STEPPING, __func__);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return change(c, RDPI_FMU_STEPPING, RDPI_FMU_TERMINATED, __func__);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    instance_t *instance = (instance_t *)c;
    if (instance == NULL) {
        return fmi2Error;
    }
    rdpi_fmu_reset(&instance->memory);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    const instance_t *instance = (const instance_t *)c;
    size_t i;
    if (instance == NULL || (nvr > 0u && (vr == NULL || value == NULL))) {
        return refuse(instance, __func__, "an argument is missing");
    }
    for (i = 0; i < nvr; i++) {
        if (!rdpi_fmu_get(&instance->memory, vr[i], &value[i])) {
            return refuse(instance, __func__, "a value reference is of no number");
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Boolean value[])
{
    const instance_t *instance = (const instance_t *)c;
    size_t i;
    if (instance == NULL || (nvr > 0u && (vr == NULL || value == NULL))) {
        return refuse(instance, __func__, "an argument is missing");
    }
    for (i = 0; i < nvr; i++) {
        bool set = false;
        if (!rdpi_fmu_flag(instance->memory.flags, vr[i] - RDPI_FMU_FIRST_FLAG, &set)) {
            return refuse(instance, __func__, "a value reference is of no flag");
        }
        value[i] = set ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Integer value[])
{
    (void)vr;
    (void)value;
    return none_of((const instance_t *)c, nvr, __func__);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         fmi2String value[])
{
    (void)vr;
    (void)value;
    return none_of((const instance_t *)c, nvr, __func__);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                       const fmi2Real value[])
{
    instance_t *instance = (instance_t *)c;
    size_t i;
    if (instance == NULL || (nvr > 0u && (vr == NULL || value == NULL))) {
        return refuse(instance, __func__, "an argument is missing");
    }
    for (i = 0; i < nvr; i++) {
        if (!rdpi_fmu_set(&instance->memory, vr[i], value[i])) {
            return refuse(instance, __func__, "only inputs can be set, and before the end");
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Integer value[])
{
    (void)vr;
    (void)value;
    return none_of((const instance_t *)c, nvr, __func__);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return none_of((const instance_t *)c, nvr, __func__);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[])
{
    (void)vr;
    (void)value;
    return none_of((const instance_t *)c, nvr, __func__);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    const instance_t *instance = (const instance_t *)c;
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    if (instance == NULL || FMUstate == NULL
        || !rdpi_fmu_keep(&instance->memory, FMUstate, message)) {
        return refuse(instance, __func__, message);
    }
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    instance_t *instance = (instance_t *)c;
    if (instance == NULL || FMUstate == NULL) {
        return refuse(instance, __func__, "an argument is missing");
    }
    memcpy(&instance->memory, FMUstate, sizeof instance->memory);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    if (c == NULL) {
        return fmi2Error;
    }
    if (FMUstate != NULL) {
        free(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    if (c == NULL || FMUstate == NULL || size == NULL) {
        return refuse((const instance_t *)c, __func__, "an argument is missing");
    }
    *size = RDPI_FMU_BYTES;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size)
{
    if (c == NULL || FMUstate == NULL || serializedState == NULL || size < RDPI_FMU_BYTES) {
        return refuse((const instance_t *)c, __func__, "an argument is missing, or too small");
    }
    rdpi_fmu_write((const rdpi_fmu_memory *)FMUstate, serializedState);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    if (c == NULL || FMUstate == NULL
        || !rdpi_fmu_read(serializedState, size, FMUstate, message)) {
        return refuse((const instance_t *)c, __func__, message);
    }
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    (void)vUnknown_ref;
    (void)nUnknown;
    (void)vKnown_ref;
    (void)nKnown;
    (void)dvKnown;
    (void)dvUnknown;
    return refuse((const instance_t *)c, __func__, "there are no derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return refuse((const instance_t *)c, __func__, "inputs are held for the whole step");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)nvr;
    (void)order;
    (void)value;
    return refuse((const instance_t *)c, __func__, "there are no derivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint,
                      fmi2Real communicationStepSize, fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    instance_t *instance = (instance_t *)c;
    char message[RDPI_FMU_MESSAGE];
    (void)noSetFMUStatePriorToCurrentPoint;
    if (instance == NULL) {
        return fmi2Error;
    }
    if (!rdpi_fmu_run(&instance->memory, currentCommunicationPoint, communicationStepSize, message)) {
        return refuse(instance, __func__, message);
    }
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refuse((const instance_t *)c, __func__, "no step is under way: a step ends in its call");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s;
    (void)value;
    return c != NULL ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    const instance_t *instance = (const instance_t *)c;
    if (instance == NULL || value == NULL) {
        return refuse(instance, __func__, "an argument is missing");
    }
    if (s != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = instance->memory.time_s;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s;
    (void)value;
    return c != NULL ? fmi2Discard : fmi2Error;
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

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s;
    (void)value;
    return c != NULL ? fmi2Discard : fmi2Error;
}
