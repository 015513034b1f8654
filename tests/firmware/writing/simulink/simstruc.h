/* As much of Simulink's SimStruct as the S-functions use, to compile and to run them without it. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H

#include <stdlib.h>

typedef double real_T;
typedef int int_T;
enum { SS_DOUBLE = 7, SS_OPTION_EXCEPTION_FREE_CODE = 1, USE_DEFAULT_OPERATING_POINT = 1 };

typedef struct {
    int_T expected, given, states, inputs, outputs, times, works, options, compliance;
    int_T input_width[4], contiguous[4], feedthrough[4], output_width[4];
    int_T work_width, work_type;
    const real_T *input[4];
    real_T *output[4];
    real_T *work;
    real_T sample_s, offset_s;
} SimStruct;

#define ssSetNumSFcnParams(S, n) ((S)->expected = (n))
#define ssGetNumSFcnParams(S) ((S)->expected)
#define ssGetSFcnParamsCount(S) ((S)->given)
#define ssSetNumContStates(S, n) ((S)->states += (n))
#define ssSetNumDiscStates(S, n) ((S)->states += (n))
#define ssSetNumInputPorts(S, n) (((S)->inputs = (n)) > 0)
#define ssSetInputPortWidth(S, p, n) ((S)->input_width[p] = (n))
#define ssSetInputPortRequiredContiguous(S, p, yes) ((S)->contiguous[p] = (yes))
#define ssSetInputPortDirectFeedThrough(S, p, yes) ((S)->feedthrough[p] = (yes))
#define ssGetInputPortRealSignal(S, p) ((S)->input[p])
#define ssSetNumOutputPorts(S, n) (((S)->outputs = (n)) > 0)
#define ssSetOutputPortWidth(S, p, n) ((S)->output_width[p] = (n))
#define ssGetOutputPortRealSignal(S, p) ((S)->output[p])
#define ssSetNumSampleTimes(S, n) ((S)->times = (n))
#define ssSetNumDWork(S, n) (((S)->works = (n)) > 0)
#define ssSetDWorkWidth(S, w, n) ((S)->work_width = (n))
#define ssSetDWorkDataType(S, w, type) ((S)->work_type = (type))
#define ssGetDWork(S, w) ((void *)(S)->work)
#define ssSetOperatingPointCompliance(S, how) ((S)->compliance = (how))
#define ssSetOptions(S, some) ((S)->options = (some))
#define ssSetSampleTime(S, n, t) ((S)->sample_s = (t))
#define ssSetOffsetTime(S, n, t) ((S)->offset_s = (t))

#endif
