/* A small importer of an FMU, with the standard's own headers: two instances side by side, copies of
 * a state as they are and as bytes, refused calls, reset. It prints what the first instance returns.
 *
 *     importer LIBRARY TOKEN TS INPUTS < inputs > outputs
 *
 * Compiled with -DVERSION=2 or 3; with -DLINKED the FMU is linked in, and LIBRARY is not looked at. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if VERSION == 2
#include "fmi2Functions.h"
#define NAME(rest) NAME_OF(rest)
#define NAME_OF(rest) fmi2##rest
#define INSTANCE fmi2Component
#define STATE fmi2FMUstate
#define BYTE fmi2Byte
#define GetFMUState GetFMUstate
#define SetFMUState SetFMUstate
#define FreeFMUState FreeFMUstate
#define SerializedFMUStateSize SerializedFMUstateSize
#define SerializeFMUState SerializeFMUstate
#define DeserializeFMUState DeSerializeFMUstate
#define GetFloat64 GetReal
#define SetFloat64 SetReal
#else
#include "fmi3Functions.h"
#define NAME(rest) NAME_OF(rest)
#define NAME_OF(rest) fmi3##rest
#define INSTANCE fmi3Instance
#define STATE fmi3FMUState
#define BYTE fmi3Byte
#endif

#define PASTE(a, b) a##b
#define TYPE_OF(name) PASTE(name, TYPE)
#ifdef LINKED
#define LOAD(name) TYPE_OF(name) *const PASTE(my_, name) = name
#else
#include <dlfcn.h>
#define LOAD(name) \
    TYPE_OF(name) *PASTE(my_, name); \
    *(void **)&PASTE(my_, name) = dlsym(library, TEXT(name)); \
    CHECK(PASTE(my_, name) != NULL)
#endif
#define TEXT(name) TEXT_OF(name)
#define TEXT_OF(name) #name
#define CALL(rest) MINE(NAME(rest))
#define MINE(name) PASTE(my_, name)
#define CHECK(truth) \
    do { \
        if (!(truth)) { \
            fprintf(stderr, "line %d: %s\n", __LINE__, #truth); \
            exit(3); \
        } \
    } while (0)
#define OK(call) CHECK((call) == 0)
#define REFUSED(call) \
    do { \
        const int before = messages; \
        CHECK((call) == 3 && messages == before + 1); \
    } while (0)

enum { OUTPUT = 2, FIRST_INPUT = 10, MOST = 64 };

static int messages;

#if VERSION == 2
static void hear(void *environment, const char *name, fmi2Status status, const char *category,
                 const char *message, ...)
{
    char text[400];
    va_list rest;
    va_start(rest, message);
    vsnprintf(text, sizeof text, message, rest);
    va_end(rest);
    CHECK(environment == &messages && status == fmi2Error && strlen(name) == 1);
    fprintf(stderr, "%s: %s\n", category, text);
    messages++;
}
#else
static void hear(void *environment, fmi3Status status, const char *category, const char *message)
{
    CHECK(environment == &messages && status == fmi3Error);
    fprintf(stderr, "%s: %s\n", category, message);
    messages++;
}
#endif

int main(int count, char **arguments)
{
    CHECK(count == 5);
#ifndef LINKED
    void *library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        return 2;
    }
#endif
    const char *token = arguments[2];
    const double ts = strtod(arguments[3], NULL);
    const int inputs = atoi(arguments[4]);
    CHECK(inputs > 0 && inputs <= MOST);
    LOAD(NAME(GetVersion));
    LOAD(NAME(FreeInstance));
    LOAD(NAME(EnterInitializationMode));
    LOAD(NAME(ExitInitializationMode));
    LOAD(NAME(Terminate));
    LOAD(NAME(Reset));
    LOAD(NAME(GetFloat64));
    LOAD(NAME(SetFloat64));
    LOAD(NAME(GetFMUState));
    LOAD(NAME(SetFMUState));
    LOAD(NAME(FreeFMUState));
    LOAD(NAME(SerializedFMUStateSize));
    LOAD(NAME(SerializeFMUState));
    LOAD(NAME(DeserializeFMUState));
    LOAD(NAME(DoStep));
#if VERSION == 2
    const fmi2CallbackFunctions callbacks = {hear, calloc, free, NULL, &messages};
    LOAD(fmi2Instantiate);
    LOAD(fmi2SetupExperiment);
    LOAD(fmi2GetRealStatus);
#define MAKE(name, type, its) CALL(Instantiate)(name, type, its, "", &callbacks, 0, 0)
#define BEGIN(c) \
    OK(CALL(SetupExperiment)(c, 0, 0.0, 2.0, 0, 0.0)); \
    OK(CALL(EnterInitializationMode)(c))
#define STEP(c, time, size) CALL(DoStep)(c, time, size, 1)
#define VALUES(n, values) n, values
    CHECK(MAKE("a", fmi2ModelExchange, token) == NULL && messages == 1);
    CHECK(MAKE("a", fmi2CoSimulation, "no token") == NULL && messages == 2);
    fmi2Component a = MAKE("a", fmi2CoSimulation, token), b = MAKE("b", fmi2CoSimulation, token);
#else
    bool event, end, early;
    double last;
    LOAD(fmi3InstantiateCoSimulation);
    LOAD(fmi3InstantiateModelExchange);
#define MAKE(name, its) \
    CALL(InstantiateCoSimulation)(name, its, "", 0, 0, 0, 0, NULL, 0, &messages, hear, NULL)
#define BEGIN(c) OK(CALL(EnterInitializationMode)(c, 0, 0.0, 2.0, 0, 0.0))
#define STEP(c, time, size) CALL(DoStep)(c, time, size, 1, &event, &end, &early, &last)
#define VALUES(n, values) n, values, n
    CHECK(CALL(InstantiateModelExchange)("a", token, "", 0, 0, &messages, hear) == NULL);
    CHECK(MAKE("a", "no token") == NULL && messages == 2);
    fmi3Instance a = MAKE("a", token), b = MAKE("b", token);
#endif
    unsigned references[MOST], output = OUTPUT, sampling = 1;
    double row[MOST], first[MOST], other[MOST], value = 0.0, returned = 0.0;
    int k;
    CHECK(strcmp(CALL(GetVersion)(), VERSION == 2 ? "2.0" : "3.0") == 0);
    CHECK(a != NULL && b != NULL);
    for (int i = 0; i < MOST; i++) {
        references[i] = (unsigned)(FIRST_INPUT + i);
        other[i] = 0.25;
    }
    REFUSED(STEP(a, 0.0, ts));
    BEGIN(a);
    BEGIN(b);
    REFUSED(CALL(EnterInitializationMode)(a
#if VERSION == 3
                                          , 0, 0.0, 0.0, 0, 0.0
#endif
                                          ));
    OK(CALL(ExitInitializationMode)(a));
    OK(CALL(ExitInitializationMode)(b));
    OK(CALL(GetFloat64)(a, &sampling, VALUES(1, &value)));
    CHECK(value == ts);
    OK(CALL(GetFloat64)(a, &output, VALUES(1, &value)));
    printf("%.17g\n", value);
    REFUSED(CALL(SetFloat64)(a, &output, VALUES(1, &value)));
    for (k = 0;; k++) {
        const double now = 2.0 + k * ts, next = 2.0 + (k + 1) * ts;
        int i = 0;
        while (i < inputs && scanf("%la", &row[i]) == 1) {
            i++;
        }
        if (i < inputs) {
            break;
        }
        if (k == 0) {
            memcpy(first, row, sizeof row);
        }
        OK(CALL(SetFloat64)(a, references, VALUES((size_t)inputs, row)));
        if (k % 7 == 3) { /* steps that are refused leave no trace */
            REFUSED(STEP(a, now, 1.5 * ts));
            REFUSED(STEP(a, now, 0.0));
            REFUSED(STEP(a, now, -ts));
            REFUSED(STEP(a, now, 1e300));
            REFUSED(STEP(a, now, 0.0 * -1e300 / 0.0));
            REFUSED(STEP(a, next, ts));
        }
        if (k % 7 == 5) { /* nor do steps whose state is taken back */
            STATE state = NULL, again = NULL;
            size_t size = 0;
            OK(CALL(GetFMUState)(a, &state));
            OK(CALL(GetFMUState)(a, &state)); /* into the same copy */
            OK(CALL(SerializedFMUStateSize)(a, state, &size));
            BYTE *bytes = malloc(size);
            OK(CALL(SerializeFMUState)(a, state, bytes, size));
            OK(CALL(SetFloat64)(a, references, VALUES((size_t)inputs, other)));
            OK(STEP(a, now, 3.0 * ts));
            if (k % 2) {
                OK(CALL(SetFMUState)(a, state));
            } else {
                OK(CALL(DeserializeFMUState)(a, bytes, size, &again));
                OK(CALL(SetFMUState)(a, again));
                REFUSED(CALL(DeserializeFMUState)(a, bytes, size - 1, &again));
                OK(CALL(FreeFMUState)(a, &again));
                bytes[0] = (BYTE)(bytes[0] + 1);
                REFUSED(CALL(DeserializeFMUState)(a, bytes, size, &again));
            }
            free(bytes);
            OK(CALL(FreeFMUState)(a, &state));
            CHECK(state == NULL);
        }
        OK(STEP(a, now, next - now));
        OK(CALL(SetFloat64)(b, references, VALUES((size_t)inputs, other)));
        OK(STEP(b, 2.0 + 2 * k * ts, 2.0 * ts));
        OK(CALL(GetFloat64)(a, &output, VALUES(1, &value)));
        printf("%.17g\n", value);
        if (k == 0) {
            returned = value;
        }
    }
    CHECK(k > 0);
#if VERSION == 2
    OK(CALL(GetRealStatus)(a, fmi2LastSuccessfulTime, &value));
#else
    OK(STEP(a, 2.0 + k * ts, ts));
    CHECK(last > 2.0 + k * ts && !event && !end && !early);
#endif
    OK(CALL(Terminate)(a));
    REFUSED(CALL(SetFloat64)(a, references, VALUES((size_t)inputs, first)));
    OK(CALL(Reset)(a));
    BEGIN(a);
    OK(CALL(SetFloat64)(a, references, VALUES((size_t)inputs, first)));
    OK(CALL(ExitInitializationMode)(a));
    OK(STEP(a, 2.0, ts));
    OK(CALL(GetFloat64)(a, &output, VALUES(1, &value)));
    CHECK(value == returned);
    CALL(FreeInstance)(a);
    CALL(FreeInstance)(b);
    CALL(FreeInstance)(NULL);
#ifndef LINKED
    dlclose(library);
#endif
    return 0;
}
