/* What runs an S-function here: two blocks side by side, the second fed with other numbers. It reads the
 * inputs of the first block from its standard input, and prints its outputs, one line for each sample. */
#include <stdio.h>

static void made(SimStruct *S)
{
    int_T port;
    mdlInitializeSizes(S);
    mdlInitializeSampleTimes(S);
    for (port = 0; port < S->inputs; port++) {
        if (S->contiguous[port] != 1) {
            exit(3);
        }
        S->input[port] = (real_T *)calloc((size_t)S->input_width[port], sizeof(real_T));
    }
    for (port = 0; port < S->outputs; port++) {
        S->output[port] = (real_T *)calloc((size_t)S->output_width[port], sizeof(real_T));
    }
    S->work = (real_T *)calloc((size_t)S->work_width, sizeof(real_T));
    if (S->expected != 0 || S->works != 1 || S->work_type != SS_DOUBLE || S->times != 1
        || S->states != 0 || S->compliance != 1 || S->options != 1 || S->offset_s < 0.0) {
        exit(4);
    }
    mdlInitializeConditions(S);
}

static void freed(SimStruct *S)
{
    int_T port;
    mdlTerminate(S);
    for (port = 0; port < S->inputs; port++) {
        union {
            const real_T *read;
            real_T *own;
        } signal;
        signal.read = S->input[port];
        free(signal.own);
    }
    for (port = 0; port < S->outputs; port++) {
        free(S->output[port]);
    }
    free(S->work);
}

static int_T fed(SimStruct *S, int_T own)
{
    int_T port, place;
    for (port = 0; port < S->inputs; port++) {
        union {
            const real_T *read;
            real_T *own;
        } signal;
        signal.read = S->input[port];
        for (place = 0; place < S->input_width[port]; place++) {
            signal.own[place] = 0.5;
            if (own != 0 && scanf("%la", &signal.own[place]) != 1) {
                return 0;
            }
        }
    }
    return 1;
}

int main(void)
{
    static SimStruct blocks[2];
    int_T port, place;
    made(&blocks[0]);
    made(&blocks[1]);
    printf("%.17g %d\n", blocks[0].sample_s, blocks[0].feedthrough[0]);
    while (fed(&blocks[0], 1) != 0 && fed(&blocks[1], 0) != 0) {
        mdlOutputs(&blocks[0], 0);
        mdlOutputs(&blocks[1], 0);
        mdlOutputs(&blocks[0], 0); /* as Simulink may, where a loop is algebraic */
        for (port = 0; port < blocks[0].outputs; port++) {
            for (place = 0; place < blocks[0].output_width[port]; place++) {
                printf("%.17g ", blocks[0].output[port][place]);
            }
        }
        printf("\n");
        mdlUpdate(&blocks[0], 0);
        mdlUpdate(&blocks[1], 0);
    }
    freed(&blocks[0]);
    freed(&blocks[1]);
    return 0;
}
