{{ ["FMI 3.0 co-simulation around etcfit_plant.c: " ~ title] | c_comment }}

/*
 * Written from the standard's text (FMI 3.0.2, sections 2.2, 2.3 and 4); it needs no header besides C99's.
 * Value references: 0 time, 1 to {{ inputs }} inputs, then outputs, then parameters, in the order of modelDescription.xml.
 */
#include "etcfit_plant.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef uint32_t reference;
typedef void (*log_message)(void *environment, fmi3Status status, const char *category, const char *message);
typedef void (*intermediate_update)(void *, double, bool, bool, bool, bool, bool *, double *);

enum { INPUTS = {{ inputs }}, OUTPUTS = {{ outputs }}, PARAMETERS = {{ parameters }} };
enum { FIRST_INPUT = 1, FIRST_OUTPUT = FIRST_INPUT + INPUTS, FIRST_PARAMETER = FIRST_OUTPUT + OUTPUTS,
       END = FIRST_PARAMETER + PARAMETERS };

typedef struct {
    etcfit_plant plant;
    etcfit_plant_input drive;
    double start;  /* angle at the begin, rad */
    double begin;  /* time at the begin, s */
    uint64_t done; /* steps since then */
    bool running;
} model;

typedef struct {
    model now; /* all that changes */
    void *environment;
    log_message log;
} instance;

static fmi3Status refused(const instance *of, const char *why)
{
    if (of->log != NULL) {
        of->log(of->environment, fmi3Error, "logStatusError", why);
    }
    return fmi3Error;
}

static void start_again(model *now)
{
    now->plant.parameters = etcfit_plant_fitted;
    now->drive.voltage = 0.0;
    now->drive.torque = 0.0;
    now->start = {{ start | number }};
    now->begin = 0.0;
    now->done = 0u;
    now->running = false;
}

static void rest(model *now)
{
    const etcfit_plant_parameters parameters = now->plant.parameters;
    etcfit_plant_init(&now->plant, &parameters, now->start);
}

static double time_of(const model *now)
{
    return now->begin + (double)now->done * ETCFIT_PLANT_STEP;
}

/* The parameters are doubles only, one behind the other. */
static double *parameter(model *now, reference of)
{
    return (double *)(void *)&now->plant.parameters + (of - FIRST_PARAMETER);
}

static double output(model *now, reference of)
{
    etcfit_plant_output seen;
    etcfit_plant_read(&now->plant, &seen);
    return ((const double *)(const void *)&seen)[of - FIRST_OUTPUT];
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Status fmi3SetDebugLogging(void *of, bool on, size_t count, const char *const categories[])
{
    (void)of, (void)on, (void)count, (void)categories;
    return fmi3OK;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early, const reference required[],
                                         size_t count, void *environment, log_message log, intermediate_update update)
{
    instance *of;
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)count;
    (void)update;
    if (token == NULL || strcmp(token, "{{ token }}") != 0) {
        if (log != NULL) {
            log(environment, fmi3Error, "logStatusError", "the instantiation token is another FMU's");
        }
        return NULL;
    }
    of = calloc(1u, sizeof *of);
    if (of != NULL) {
        of->environment = environment;
        of->log = log;
        start_again(&of->now);
        rest(&of->now);
    }
    return of;
}

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                          bool logging, void *environment, log_message log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log != NULL) {
        log(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation only: see its documentation");
    }
    return NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                               bool visible, bool logging, void *environment, log_message log,
                                               void (*update)(void *), void (*lock)(void), void (*unlock)(void))
{
    (void)update, (void)lock, (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

EXPORT void fmi3FreeInstance(void *of)
{
    free(of);
}

EXPORT fmi3Status fmi3EnterInitializationMode(void *of, bool tolerance_defined, double tolerance, double start,
                                              bool stop_defined, double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((instance *)of)->now.begin = start;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(void *of)
{
    model *now = &((instance *)of)->now;
    rest(now);
    now->running = true;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(void *of)
{
    (void)of;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(void *of)
{
    start_again(&((instance *)of)->now);
    rest(&((instance *)of)->now);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(void *of, const reference which[], size_t count, double values[], size_t room)
{
    model *now = &((instance *)of)->now;
    size_t k;
    if (room < count) {
        return refused(of, "fmi3GetFloat64: fewer values than value references");
    }
    if (!now->running) {
        rest(now); /* what a user sets before the begin shows at once */
    }
    for (k = 0u; k < count; k++) {
        if (which[k] == 0u) {
            values[k] = time_of(now);
        } else if (which[k] < FIRST_OUTPUT) {
            values[k] = which[k] == FIRST_INPUT ? now->drive.voltage : now->drive.torque;
        } else if (which[k] < FIRST_PARAMETER) {
            values[k] = output(now, which[k]);
        } else if (which[k] < END) {
            values[k] = *parameter(now, which[k]);
        } else if (which[k] == END) {
            values[k] = now->start;
        } else {
            return refused(of, "fmi3GetFloat64: no such value reference");
        }
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(void *of, const reference which[], size_t count, const double values[], size_t room)
{
    model *now = &((instance *)of)->now;
    size_t k;
    if (room < count) {
        return refused(of, "fmi3SetFloat64: fewer values than value references");
    }
    for (k = 0u; k < count; k++) {
        if (which[k] == FIRST_INPUT) {
            now->drive.voltage = values[k];
        } else if (which[k] == FIRST_INPUT + 1) {
            now->drive.torque = values[k];
        } else if (which[k] >= FIRST_PARAMETER && which[k] < END) {
            *parameter(now, which[k]) = values[k];
        } else if (which[k] == END && !now->running) {
            now->start = values[k];
        } else {
            return refused(of, "fmi3SetFloat64: neither an input nor a parameter, or one that is fixed by now");
        }
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(void *of, double point, double size, bool no_return, bool *event, bool *terminate,
                             bool *early, double *last)
{
    model *now = &((instance *)of)->now;
    const double steps = floor(size / ETCFIT_PLANT_STEP + 0.5);
    uint64_t k;
    (void)no_return;
    *event = *terminate = *early = false;
    *last = time_of(now);
    if (fabs(point - *last) > 1e-3 * ETCFIT_PLANT_STEP) {
        return refused(of, "fmi3DoStep: it does not begin where the last one ended");
    }
    if (!(size > 0.0) || fabs(size - steps * ETCFIT_PLANT_STEP) > 1e-3 * ETCFIT_PLANT_STEP) {
        return refused(of, "fmi3DoStep: the communication step must be a whole number of internal steps, "
                           "fixedInternalStepSize of modelDescription.xml");
    }
    for (k = 0u; k < (uint64_t)steps; k++) {
        etcfit_plant_step(&now->plant, &now->drive, NULL);
    }
    now->done += (uint64_t)steps;
    *last = time_of(now);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFMUState(void *of, void **state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(model));
    }
    if (*state == NULL) {
        return refused(of, "fmi3GetFMUState: out of memory");
    }
    *(model *)*state = ((instance *)of)->now;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(void *of, void *state)
{
    ((instance *)of)->now = *(model *)state;
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(void *of, void **state)
{
    (void)of;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

/* What the standard asks to be there and this FMU does not have: no other types, clocks, events or derivatives. Its
 * modelDescription.xml announces none of them, so that no importer calls these with anything. */
#define NOT_HERE(name)            \
    EXPORT fmi3Status name(void); \
    EXPORT fmi3Status name(void)  \
    {                             \
        return fmi3Error;         \
    }
{% for name in not_here %}
NOT_HERE(fmi3{{ name }})
{% endfor %}
