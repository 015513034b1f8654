/* The model as an FMU for co-simulation, FMI 3.0: see rdpi_fmu.h. */
#include "rdpi_fmi3.h"

#include "rdpi_fmu.h"

typedef struct {
    rdpi_fmu_memory memory;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance_t;

static void report(fmi3LogMessageCallback log, fmi3InstanceEnvironment environment,
                   const char *function, const char *what)
{
    char text[RDPI_FMU_MESSAGE + 60];
    if (log != NULL) {
        (void)snprintf(text, sizeof text, "%s: %s", function, what);
        log(environment, fmi3Error, "logStatusError", text);
    }
}

static fmi3Status refuse(const instance_t *instance, const char *function, const char *what)
{
    if (instance != NULL) {
        report(instance->log, instance->environment, function, what);
    }
    return fmi3Error;
}

/* For what the model has not: nothing may be asked of it, and asking for nothing is no error. */
static fmi3Status none_of(const instance_t *instance, size_t count, const char *function)
{
    return instance != NULL && count == 0u ? fmi3OK
                                           : refuse(instance, function, "the model has none of these");
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* There are errors only, and they are always told. */
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)loggingOn;
    (void)nCategories;
    (void)categories;
    return instance != NULL ? fmi3OK : fmi3Error;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible,
                                          fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    report(logMessage, instanceEnvironment, __func__, "this FMU is for co-simulation");
    return NULL;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    instance_t *instance;
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
    instance = (instance_t *)calloc(1, sizeof *instance);
    if (instance == NULL) {
        report(logMessage, instanceEnvironment, __func__, "no memory is left");
        return NULL;
    }
    instance->environment = instanceEnvironment;
    instance->log = logMessage;
    rdpi_fmu_reset(&instance->memory);
    return instance;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
    fmi3LockPreemptionCallback lockPreemption, fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    report(logMessage, instanceEnvironment, __func__, "this FMU is for co-simulation");
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined,
                                       fmi3Float64 tolerance, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    instance_t *self = (instance_t *)instance;
    char message[RDPI_FMU_MESSAGE];
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (self == NULL) {
        return fmi3Error;
    }
    if (!rdpi_fmu_is(&self->memory, RDPI_FMU_INSTANTIATED, message)
        || !rdpi_fmu_begin(&self->memory, startTime, message)) {
        return refuse(self, __func__, message);
    }
    self->memory.mode = (uint8_t)RDPI_FMU_INITIALIZING;
    return fmi3OK;
}

static fmi3Status change(fmi3Instance instance, rdpi_fmu_mode from, rdpi_fmu_mode to,
                         const char *function)
{
    instance_t *self = (instance_t *)instance;
    char message[RDPI_FMU_MESSAGE];
    if (self == NULL) {
        return fmi3Error;
    }
    if (!rdpi_fmu_is(&self->memory, from, message)) {
        return refuse(self, function, message);
    }
    self->memory.mode = (uint8_t)to;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return change(instance, RDPI_FMU_INITIALIZING, RDPI_FMU_STEPPING, __func__);
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    return change(instance, RDPI_FMU_STEPPING, RDPI_FMU_TERMINATED, __func__);
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    instance_t *self = (instance_t *)instance;
    if (self == NULL) {
        return fmi3Error;
    }
    rdpi_fmu_reset(&self->memory);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, fmi3Float64 values[], size_t nValues)
{
    const instance_t *self = (const instance_t *)instance;
    size_t i;
    if (self == NULL || nValues != nValueReferences
        || (nValues > 0u && (valueReferences == NULL || values == NULL))) {
        return refuse(self, __func__, "an argument is missing, or there is not one value for each");
    }
    for (i = 0; i < nValues; i++) {
        if (!rdpi_fmu_get(&self->memory, valueReferences[i], &values[i])) {
            return refuse(self, __func__, "a value reference is of no number");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, const fmi3Float64 values[], size_t nValues)
{
    instance_t *self = (instance_t *)instance;
    size_t i;
    if (self == NULL || nValues != nValueReferences
        || (nValues > 0u && (valueReferences == NULL || values == NULL))) {
        return refuse(self, __func__, "an argument is missing, or there is not one value for each");
    }
    for (i = 0; i < nValues; i++) {
        if (!rdpi_fmu_set(&self->memory, valueReferences[i], values[i])) {
            return refuse(self, __func__, "only inputs can be set, and before the end");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, fmi3Boolean values[], size_t nValues)
{
    const instance_t *self = (const instance_t *)instance;
    size_t i;
    if (self == NULL || nValues != nValueReferences
        || (nValues > 0u && (valueReferences == NULL || values == NULL))) {
        return refuse(self, __func__, "an argument is missing, or there is not one value for each");
    }
    for (i = 0; i < nValues; i++) {
        if (!rdpi_fmu_flag(self->memory.flags, valueReferences[i] - RDPI_FMU_FIRST_FLAG,
                           &values[i])) {
            return refuse(self, __func__, "a value reference is of no flag");
        }
    }
    return fmi3OK;
}

#define NONE_TO_GET(type) \
    fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference valueReferences[], \
                             size_t nValueReferences, fmi3##type values[], size_t nValues) \
    { \
        (void)valueReferences; \
        (void)values; \
        (void)nValues; \
        return none_of((const instance_t *)instance, nValueReferences, __func__); \
    }
#define NONE_TO_SET(type) \
    fmi3Status fmi3Set##type(fmi3Instance instance, const fmi3ValueReference valueReferences[], \
                             size_t nValueReferences, const fmi3##type values[], size_t nValues) \
    { \
        (void)valueReferences; \
        (void)values; \
        (void)nValues; \
        return none_of((const instance_t *)instance, nValueReferences, __func__); \
    }
#define NONE_OF(type) NONE_TO_GET(type) NONE_TO_SET(type)

NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(Int32)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(String)
NONE_TO_SET(Boolean)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, size_t valueSizes[], fmi3Binary values[],
                         size_t nValues)
{
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    (void)nValues;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, const size_t valueSizes[],
                         const fmi3Binary values[], size_t nValues)
{
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    (void)nValues;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, fmi3Clock values[])
{
    (void)valueReferences;
    (void)values;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, const fmi3Clock values[])
{
    (void)valueReferences;
    (void)values;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance,
                                               fmi3ValueReference valueReference,
                                               size_t *nDependencies)
{
    (void)valueReference;
    (void)nDependencies;
    return refuse((const instance_t *)instance, __func__, "dependencies are in the description");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[],
                                       fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    (void)dependent;
    (void)elementIndicesOfDependent;
    (void)independents;
    (void)elementIndicesOfIndependents;
    (void)dependencyKinds;
    (void)nDependencies;
    return refuse((const instance_t *)instance, __func__, "dependencies are in the description");
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    const instance_t *self = (const instance_t *)instance;
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    if (self == NULL || FMUState == NULL || !rdpi_fmu_keep(&self->memory, FMUState, message)) {
        return refuse(self, __func__, message);
    }
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    instance_t *self = (instance_t *)instance;
    if (self == NULL || FMUState == NULL) {
        return refuse(self, __func__, "an argument is missing");
    }
    memcpy(&self->memory, FMUState, sizeof self->memory);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    if (instance == NULL) {
        return fmi3Error;
    }
    if (FMUState != NULL) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    if (instance == NULL || FMUState == NULL || size == NULL) {
        return refuse((const instance_t *)instance, __func__, "an argument is missing");
    }
    *size = RDPI_FMU_BYTES;
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState,
                                 fmi3Byte serializedState[], size_t size)
{
    if (instance == NULL || FMUState == NULL || serializedState == NULL || size < RDPI_FMU_BYTES) {
        return refuse((const instance_t *)instance, __func__,
                      "an argument is missing, or too small");
    }
    rdpi_fmu_write((const rdpi_fmu_memory *)FMUState, serializedState);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[],
                                   size_t size, fmi3FMUState *FMUState)
{
    char message[RDPI_FMU_MESSAGE] = "an argument is missing";
    if (instance == NULL || FMUState == NULL
        || !rdpi_fmu_read(serializedState, size, FMUState, message)) {
        return refuse((const instance_t *)instance, __func__, message);
    }
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                        size_t nUnknowns, const fmi3ValueReference knowns[],
                                        size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                        fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)unknowns;
    (void)nUnknowns;
    (void)knowns;
    (void)nKnowns;
    (void)seed;
    (void)nSeed;
    (void)sensitivity;
    (void)nSensitivity;
    return refuse((const instance_t *)instance, __func__, "there are no derivatives");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t nUnknowns, const fmi3ValueReference knowns[],
                                    size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                    fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)unknowns;
    (void)nUnknowns;
    (void)knowns;
    (void)nKnowns;
    (void)seed;
    (void)nSeed;
    (void)sensitivity;
    (void)nSensitivity;
    return refuse((const instance_t *)instance, __func__, "there are no derivatives");
}

#define NO_MODE(name) \
    fmi3Status name(fmi3Instance instance) \
    { \
        return refuse((const instance_t *)instance, __func__, "the model has no such mode"); \
    }

NO_MODE(fmi3EnterConfigurationMode)
NO_MODE(fmi3ExitConfigurationMode)
NO_MODE(fmi3EnterEventMode)
NO_MODE(fmi3EnterStepMode)
NO_MODE(fmi3EvaluateDiscreteStates)

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    (void)discreteStatesNeedUpdate;
    (void)terminateSimulation;
    (void)nominalsOfContinuousStatesChanged;
    (void)valuesOfContinuousStatesChanged;
    (void)nextEventTimeDefined;
    (void)nextEventTime;
    return refuse((const instance_t *)instance, __func__, "the model has no such mode");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences;
    (void)intervals;
    (void)qualifiers;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, fmi3Float64 shifts[])
{
    (void)valueReferences;
    (void)shifts;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, const fmi3Float64 intervals[])
{
    (void)valueReferences;
    (void)intervals;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, const fmi3Float64 shifts[])
{
    (void)valueReferences;
    (void)shifts;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    return none_of((const instance_t *)instance, nValueReferences, __func__);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance,
                                    const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t nValues)
{
    (void)valueReferences;
    (void)nValueReferences;
    (void)orders;
    (void)values;
    (void)nValues;
    return refuse((const instance_t *)instance, __func__, "there are no derivatives");
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    instance_t *self = (instance_t *)instance;
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

/* Model exchange and scheduled execution: no instance of theirs can be made. */
#define NO_NUMBERS(name, numbers) \
    fmi3Status name(fmi3Instance instance, numbers, size_t count) \
    { \
        (void)values; \
        return none_of((const instance_t *)instance, count, __func__); \
    }

NO_MODE(fmi3EnterContinuousTimeMode)
NO_NUMBERS(fmi3SetContinuousStates, const fmi3Float64 values[])
NO_NUMBERS(fmi3GetContinuousStateDerivatives, fmi3Float64 values[])
NO_NUMBERS(fmi3GetEventIndicators, fmi3Float64 values[])
NO_NUMBERS(fmi3GetContinuousStates, fmi3Float64 values[])
NO_NUMBERS(fmi3GetNominalsOfContinuousStates, fmi3Float64 values[])

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance,
                                       fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode,
                                       fmi3Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    (void)enterEventMode;
    (void)terminateSimulation;
    return refuse((const instance_t *)instance, __func__, "this FMU is for co-simulation");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    (void)time;
    return refuse((const instance_t *)instance, __func__, "this FMU is for co-simulation");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    (void)nEventIndicators;
    return refuse((const instance_t *)instance, __func__, "this FMU is for co-simulation");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    (void)nContinuousStates;
    return refuse((const instance_t *)instance, __func__, "this FMU is for co-simulation");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime)
{
    (void)clockReference;
    (void)activationTime;
    return refuse((const instance_t *)instance, __func__, "this FMU is for co-simulation");
}
