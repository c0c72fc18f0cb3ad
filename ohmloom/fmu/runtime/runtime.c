/*
 * The runtime of ohmloom's models: FMI 2.0 or 3.0 (FMI_VERSION), continuous or discrete (MODEL_IS_DISCRETE). It includes
 * model.c, which tells it the sizes, the variables and the equations. An FMU's copy holds what it needs of this file.
 *
#if MODEL_IS_DISCRETE
 * A discrete model has parameters p, inputs u, outputs y, and a Memory that changes once per timestep:
 *
 *     start(p, memory),  step(p, u, memory),  y = outputs(p, memory)
 *
 * Outputs are those of the last timestep, or of the start. It is for co-simulation alone.
 *
 * Values lie in one table indexed by value reference: time, parameters, inputs, outputs.
#else
 * A continuous model is for model exchange and co-simulation, and has the equations
 *
 *     x' = rates(p, c, u, x),  y = outputs(p, c, u, x),  low <= x <= high,  c = constants(p)
 *
 * and their derivatives: forward sets (drates, dy) from (du, dx), adjoint adds to (du, dx) from (drates, dy). Where it has
 * one state in a closed form, x after a time = flow(p, c, u, x, time) is that (MODEL_HAS_FLOW).
 *
 * The first N_LIMITED states have limits; the others' are infinite. A state that reaches a limit rests there (its mode is
 * that limit) until its rate points inward; both are events. The rates themselves know nothing of modes: they are smooth,
 * and evaluated within the limits.
 *
 * Values lie in one table indexed by value reference: time, parameters, inputs, states, derivatives, outputs, indicators.
#endif
 * Everything that changes is in State, which holds no pointer, so saving an instance is copying a block of memory.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if FMI_VERSION == 2
#include "fmi2Functions.h"
#else
#include "fmi3Functions.h"
#endif

typedef enum { TIME, TUNABLE, FIXED, INPUT, CALCULATED } Role;
#if MODEL_IS_DISCRETE
typedef enum { REAL, INTEGER, BOOLEAN } Type;
#endif

typedef struct {
    char name[LONGEST_NAME + 1]; /* no pointer: nothing is left to do when the library is loaded */
#if MODEL_IS_DISCRETE
    Type type;
#endif
    Role role;
    double start, low, high;
} Variable;

/* Size before speed: of what is seldom called. */
#if defined(__clang__)
#define SELDOM __attribute__((minsize))
#elif defined(__GNUC__)
#define SELDOM __attribute__((cold))
#else
#define SELDOM
#endif

#include "model.c"

enum {
    FIRST_P = 1,
    FIRST_U = FIRST_P + N_P,
#if MODEL_IS_DISCRETE
    FIRST_Y = FIRST_U + N_U,
    N_VALUES = FIRST_Y + N_Y
#else
    FIRST_X = FIRST_U + N_U,
    FIRST_DX = FIRST_X + N_X,
    FIRST_Y = FIRST_DX + N_X,
    FIRST_Z = FIRST_Y + N_Y,
    N_Z = 2 * N_LIMITED,
    N_VALUES = FIRST_Z + N_Z
#endif
};

/* The phases of an instance; each function names those in which it may be called. */
enum { CREATED = 1, INITIALIZING = 2, EVENT = 4, CONTINUOUS = 8, STEPPING = 16, TERMINATED = 32, FAILED = 64 };
#define RUNNING (EVENT | CONTINUOUS | STEPPING)
#define LIVING (CREATED | INITIALIZING | RUNNING | TERMINATED)

typedef struct {
    double value[N_VALUES];
#if MODEL_IS_DISCRETE
    Memory memory;
    signed char phase, is_cosimulation, constants_known, outputs_known;
#else
    double constant[N_C];
    double low[N_X], high[N_X];
    double raw[N_X];    /* rates before modes */
    signed char mode[N_X]; /* -1: rests at low, 1: rests at high, 0: moves */
    signed char phase, is_cosimulation, constants_known, rates_known, outputs_known;
    double tolerance, step; /* step: what the error of the last one suggests, 0 at the start */
#endif
} State;

typedef struct {
    State s;
#if FMI_VERSION == 2
    const fmi2CallbackFunctions *host;
#else
    fmi3LogMessageCallback log;
    void *environment;
#endif
    int is_talkative;
    char *name;
} Instance;

/* What a stored state begins with; all of it must match where it is restored. */
typedef struct {
    char magic[8];
    unsigned int format, size;
    char token[sizeof MODEL_TOKEN];
} Label;

typedef struct {
    Label label;
    State s;
} Snapshot;

enum { GOOD = 0, BAD = 3 }; /* fmi2OK and fmi2Error, fmi3OK and fmi3Error */
#if !MODEL_IS_DISCRETE
#define TOLERANCE 1e-8
#define HYSTERESIS 1e-10 /* share of the range by which an indicator lets a state pass its limit */
#define LARGEST_COUNT 1000000 /* of steps within one communication step */
#endif

static void tell(Instance *m, int status, const char *category, const char *format, ...)
{
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
#if FMI_VERSION == 2
    if (m->host && m->host->logger)
        m->host->logger(m->host->componentEnvironment, m->name, (fmi2Status)status, category, text);
#else
    if (m->log)
        m->log(m->environment, (fmi3Status)status, category, text);
#endif
}

/* Says what is wrong, and is the status to return. */
#define refuse(m, ...) (tell(m, BAD, "logStatusError", __VA_ARGS__), BAD)

static int may_call(Instance *m, const char *function, int phases)
{
    if (m->s.phase & phases)
        return 1;
    tell(m, BAD, "logStatusError", "%s: called in a phase in which FMI does not allow it", function);
    return 0;
}

/* ------------------------------------------------------------------ the model's equations, evaluated when asked for */

static double *part(State *s, int first) { return s->value + first; }

#if !MODEL_IS_DISCRETE
/* As fmin(fmax(x, low), high), without a call. */
static double within(double x, double low, double high) { return x > high ? high : x < low ? low : x; }

static void keep_within(const State *s, const double *x, double *inside)
{
    int k;
    for (k = 0; k < N_X; k++)
        inside[k] = within(x[k], s->low[k], s->high[k]);
}
#endif

static int know_constants(Instance *m)
{
    State *s = &m->s;
    const char *problem;
    if (s->constants_known)
        return GOOD;
    problem = model_check(part(s, FIRST_P), s->phase & (CREATED | INITIALIZING));
    if (problem)
        return refuse(m, "%s", problem);
#if MODEL_IS_DISCRETE
    model_start(part(s, FIRST_P), &s->memory);
    s->constants_known = 1;
    s->outputs_known = 0;
    return GOOD;
}

static int know_outputs(Instance *m)
{
    State *s = &m->s;
    if (know_constants(m))
        return BAD;
    if (!s->outputs_known)
        model_outputs(part(s, FIRST_P), &s->memory, part(s, FIRST_Y));
    s->outputs_known = 1;
    return GOOD;
}

/* A communication step is a whole number of timesteps; inputs are held over all of them. */
static int advance(Instance *m, double duration)
{
    State *s = &m->s;
    const double count = floor(duration / TIMESTEP + 0.5);
    double k;
    if (!(count >= 1.0 && count <= 1e6 && fabs(duration - count * TIMESTEP) <= 1e-6 * TIMESTEP))
        return refuse(m, "t = %.17g s: expected a step of %g s or a multiple of it, got %.17g s", s->value[0], TIMESTEP,
                      duration);
    for (k = 0.0; k < count; k += 1.0) {
        const char *failure = model_step(part(s, FIRST_P), part(s, FIRST_U), &s->memory);
        if (failure)
            return refuse(m, "t = %.17g s: %s", s->value[0] + k * TIMESTEP, failure);
    }
    s->outputs_known = 0;
    return GOOD;
}
#else
    model_constants(part(s, FIRST_P), s->constant);
    model_limits(part(s, FIRST_P), s->constant, s->low, s->high);
    if (s->phase & (CREATED | INITIALIZING))
        model_start(part(s, FIRST_P), s->constant, part(s, FIRST_X));
    else if (s->is_cosimulation) /* in model exchange, an event update does so */
        keep_within(s, part(s, FIRST_X), part(s, FIRST_X));
    s->constants_known = 1;
    s->rates_known = s->outputs_known = 0;
    return GOOD;
}

/* What errors of a state are shares of: its range, or, where it has none, 1 of its unit. */
static double range_of(const State *s, int k) { return k < N_LIMITED ? s->high[k] - s->low[k] : 1.0; }

/* Rates at x, which is taken into the limits first: a solver's trial step may lie beyond one. */
static void rates_at(const State *s, const double *x, double *rates)
{
    double inside[N_X];
    keep_within(s, x, inside);
    model_rates(s->value + FIRST_P, s->constant, s->value + FIRST_U, inside, rates);
}

/* Chooses a state's mode: it rests at a limit where it stands and its rate points outward. */
static void choose_mode(Instance *m, int k)
{
    State *s = &m->s;
    const double x = s->value[FIRST_X + k], rate = s->raw[k];
    const int mode = x >= s->high[k] && rate > 0.0 ? 1 : x <= s->low[k] && rate < 0.0 ? -1 : 0;
    if (mode != s->mode[k] && m->is_talkative)
        tell(m, GOOD, "logEvents", "t = %.17g s: %s %s", s->value[0], variables[FIRST_X + k].name,
             mode > 0 ? "rests at its upper limit" : mode < 0 ? "rests at its lower limit" : "moves");
    s->mode[k] = (signed char)mode;
    s->value[FIRST_DX + k] = mode ? 0.0 : rate;
}

static int know_rates(Instance *m)
{
    State *s = &m->s;
    int k;
    if (know_constants(m))
        return BAD;
    if (s->rates_known)
        return GOOD;
    rates_at(s, part(s, FIRST_X), s->raw);
    for (k = 0; k < N_X; k++) {
        if (!isfinite(s->raw[k]))
            return refuse(m, "der(%s): expected a finite rate, got %g", variables[FIRST_X + k].name, s->raw[k]);
        if (s->phase & (EVENT | CONTINUOUS)) /* there, modes change in event updates alone */
            s->value[FIRST_DX + k] = s->mode[k] ? 0.0 : s->raw[k];
        else
            choose_mode(m, k);
    }
    s->rates_known = 1;
    return GOOD;
}

static int know_outputs(Instance *m)
{
    State *s = &m->s;
    double inside[N_X];
    int k;
    if (know_constants(m))
        return BAD;
    if (s->outputs_known)
        return GOOD;
    keep_within(s, part(s, FIRST_X), inside);
    model_outputs(part(s, FIRST_P), s->constant, part(s, FIRST_U), inside, part(s, FIRST_Y));
    for (k = 0; k < N_Y; k++)
        if (!isfinite(s->value[FIRST_Y + k]))
            return refuse(m, "%s: expected a finite value, got %g", variables[FIRST_Y + k].name, s->value[FIRST_Y + k]);
    s->outputs_known = 1;
    return GOOD;
}

/* Two per limited state, positive until something happens: at low, and at high. Where the state moves, its distance from
 * the limit, in shares of the range; where it rests, how strongly its rate holds it there, in ranges per second. */
static int know_indicators(Instance *m)
{
    State *s = &m->s;
    int k;
    if (know_rates(m))
        return BAD;
    for (k = 0; k < N_LIMITED; k++) {
        const double range = range_of(s, k), x = s->value[FIRST_X + k];
        double *z = s->value + FIRST_Z + 2 * k;
        z[0] = s->mode[k] < 0 ? -s->raw[k] / range + HYSTERESIS : (x - s->low[k]) / range + HYSTERESIS;
        z[1] = s->mode[k] > 0 ? s->raw[k] / range + HYSTERESIS : (s->high[k] - x) / range + HYSTERESIS;
    }
    return GOOD;
}

/* Puts states that passed a limit onto it and chooses every mode; counts the states that it moved. */
static int settle(Instance *m, int *moved)
{
    State *s = &m->s;
    int k;
    *moved = 0;
    if (know_constants(m))
        return BAD;
    for (k = 0; k < N_X; k++) {
        double *x = s->value + FIRST_X + k;
        const double held = within(*x, s->low[k], s->high[k]);
        if (held != *x) {
            *x = held;
            *moved += 1;
            s->rates_known = s->outputs_known = 0;
        }
    }
    if (know_rates(m))
        return BAD;
    for (k = 0; k < N_X; k++)
        choose_mode(m, k);
    return GOOD;
}

#if MODEL_HAS_FLOW
/* ---------------------------------------------------------------------------- co-simulation, in the model's closed form */

static double flow(const State *s, double duration)
{
    return model_flow(s->value + FIRST_P, s->constant, s->value + FIRST_U, s->value + FIRST_X, duration);
}

/* Within a duration after which the state would have passed a limit: when it arrives. */
static double arrival(const State *s, double duration)
{
    double low = 0.0, high = duration;
    int count;
    for (count = 0; count < 60; count++) {
        const double middle = 0.5 * (low + high), x = flow(s, middle);
        if (x < s->low[0] || x > s->high[0])
            high = middle;
        else
            low = middle;
    }
    return high;
}

/* From the present time on over `duration`, inputs held. A state that rests is at a limit, and passes none. */
static int advance(Instance *m, double duration)
{
    State *s = &m->s;
    double x, held;
    int moved;
    /* What only a message tells costs a look at the rates. */
    if (m->is_talkative ? settle(m, &moved) : know_constants(m))
        return BAD;
    x = flow(s, duration);
    held = within(x, s->low[0], s->high[0]);
    if (m->is_talkative && x != held && !s->mode[0])
        s->value[0] += arrival(s, duration); /* the time that the message tells */
    s->value[FIRST_X] = held;
    s->rates_known = s->outputs_known = 0;
    return m->is_talkative ? settle(m, &moved) : GOOD;
}
#else
/* --------------------------- co-simulation: Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19, orders 5 and 4 */

#define EACH(n) for (n = 0; n < N_X; n++)

/* Rates at x; a resting state has none. */
static void look(const State *s, const double *x, double *k)
{
    int n;
    rates_at(s, x, k);
    EACH(n) if (s->mode[n]) k[n] = 0.0;
}

/* One step of length h from the present state: where it leads, the rates there, and its error over the tolerance. */
static double attempt(const State *s, double h, double *x, double *rates)
{
    const double *x0 = s->value + FIRST_X, *k1 = s->value + FIRST_DX;
    double k2[N_X], k3[N_X], k4[N_X], k5[N_X], k6[N_X], worst = 0.0;
    int n;
    EACH(n) x[n] = x0[n] + h * (1.0 / 5.0 * k1[n]);
    look(s, x, k2);
    EACH(n) x[n] = x0[n] + h * (3.0 / 40.0 * k1[n] + 9.0 / 40.0 * k2[n]);
    look(s, x, k3);
    EACH(n) x[n] = x0[n] + h * (44.0 / 45.0 * k1[n] - 56.0 / 15.0 * k2[n] + 32.0 / 9.0 * k3[n]);
    look(s, x, k4);
    EACH(n) x[n] = x0[n] + h * (19372.0 / 6561.0 * k1[n] - 25360.0 / 2187.0 * k2[n] + 64448.0 / 6561.0 * k3[n] -
                                212.0 / 729.0 * k4[n]);
    look(s, x, k5);
    EACH(n) x[n] = x0[n] + h * (9017.0 / 3168.0 * k1[n] - 355.0 / 33.0 * k2[n] + 46732.0 / 5247.0 * k3[n] +
                                49.0 / 176.0 * k4[n] - 5103.0 / 18656.0 * k5[n]);
    look(s, x, k6);
    EACH(n) x[n] = x0[n] + h * (35.0 / 384.0 * k1[n] + 500.0 / 1113.0 * k3[n] + 125.0 / 192.0 * k4[n] -
                                2187.0 / 6784.0 * k5[n] + 11.0 / 84.0 * k6[n]);
    rates_at(s, x, rates);
    EACH(n) {
        const double k7 = s->mode[n] ? 0.0 : rates[n];
        double error = 71.0 / 57600.0 * k1[n] - 71.0 / 16695.0 * k3[n] + 71.0 / 1920.0 * k4[n] -
                       17253.0 / 339200.0 * k5[n] + 22.0 / 525.0 * k6[n] - 1.0 / 40.0 * k7;
        error = fabs(h * error) / (s->tolerance * range_of(s, n));
        if (!(error <= worst)) /* also when it is not a number */
            worst = error;
    }
    return worst;
}

/* By how much the first event is overstepped, in ranges (at a limit: ranges per second); none if not above 0. */
static double overstep(const State *s, const double *x, const double *rates)
{
    double most = -INFINITY;
    int n;
    for (n = 0; n < N_LIMITED; n++) {
        const double range = range_of(s, n);
        const double above = x[n] - s->high[n], below = s->low[n] - x[n];
        const double over = (s->mode[n] ? -s->mode[n] * rates[n] : above > below ? above : below) / range;
        if (over > most)
            most = over;
    }
    return most;
}

/* The shortest step that oversteps, within rounding, by the Illinois variant of false position. */
static double locate(const State *s, double h, double over, double *x, double *rates)
{
    double low = 0.0, high = h, f_low = -1.0, f_high = over;
    int count, side = 0;
    for (count = 0; count < 100 && high - low > 4e-16 * h && f_high > 4e-16; count++) {
        double middle = count < 3 ? 0.5 * (low + high) : high - f_high * (high - low) / (f_high - f_low), f;
        if (!(middle > low && middle < high))
            middle = 0.5 * (low + high);
        attempt(s, middle, x, rates);
        f = overstep(s, x, rates);
        if (f > 0.0) {
            high = middle, f_high = f;
            if (side > 0)
                f_low *= 0.5;
            side = 1;
        } else {
            low = middle, f_low = f;
            if (side < 0)
                f_high *= 0.5;
            side = -1;
        }
    }
    attempt(s, high, x, rates);
    return high;
}

/* From the present time on over `duration`, inputs held. */
static int advance(Instance *m, double duration)
{
    State *s = &m->s;
    double left = duration, x[N_X], rates[N_X];
    int count, moved;
    if (settle(m, &moved))
        return BAD;
    for (count = 0; left > 0.0; count++) {
        double h = s->step > 0.0 && s->step < left ? s->step : left, error, factor, over;
        if (count >= LARGEST_COUNT)
            return refuse(m, "t = %.17g s: expected at most %d steps in a communication step of %g s, got more: "
                             "the model is too fast for it", s->value[0], LARGEST_COUNT, duration);
        error = attempt(s, h, x, rates);
        factor = error <= 1e-4 ? 5.0 : 0.9 * pow(error, -0.2);
        if (!(error <= 1.0)) {
            s->step = h * (factor > 0.2 ? factor : 0.2); /* 0.2 also when it is not a number */
            if (s->step < 1e-15 * duration)
                return refuse(m, "t = %.17g s: no step is short enough for the tolerance %g", s->value[0], s->tolerance);
            continue;
        }
        over = overstep(s, x, rates);
        if (over > 0.0)
            h = locate(s, h, over, x, rates);
        else if (h < left || factor < 1.0 || h * factor > s->step)
            s->step = h * fmin(factor, 5.0);
        memcpy(s->value + FIRST_X, x, sizeof x);
        memcpy(s->raw, rates, sizeof rates);
        s->outputs_known = 0;
        left = h < left ? left - h : 0.0;
        s->value[0] += h;
        if (settle(m, &moved))
            return BAD;
    }
    return GOOD;
}
#endif

#endif
static int step(Instance *m, double time, double duration)
{
    int status;
    if (!may_call(m, "DoStep", STEPPING))
        return BAD;
    if (!isfinite(time) || !isfinite(duration) || !(duration > 0.0))
        return refuse(m, "DoStep: expected a finite time and a positive step, got %g s and %g s", time, duration);
    m->s.value[0] = time;
    status = advance(m, duration);
    m->s.value[0] = time + duration;
    if (status)
        m->s.phase = FAILED;
    return status;
}

/* --------------------------------------------------------------------------------------------- values and derivatives */

static int set_value(Instance *m, unsigned int reference, double number)
{
    State *s = &m->s;
    const Variable *variable = variables + reference;
    if (reference >= N_VALUES)
        return refuse(m, "expected a value reference below %d, got %u", (int)N_VALUES, reference);
    if (variable->role == CALCULATED || variable->role == TIME)
        return refuse(m, "%s: expected an input or a parameter, got a value that the model calculates", variable->name);
    if (variable->role == FIXED && !(s->phase & (CREATED | INITIALIZING)))
        return refuse(m, "%s: expected to be set before the end of initialization, got it set later", variable->name);
    if (!isfinite(number) || number < variable->low || number > variable->high)
        return refuse(m, "%s: expected a number from %g to %g, got %.17g", variable->name, variable->low, variable->high,
                      number);
    s->value[reference] = number;
#if !MODEL_IS_DISCRETE
    s->rates_known = s->outputs_known = 0;
#endif
    if (variable->role != INPUT)
        s->constants_known = 0;
    return GOOD;
}

static int get_value(Instance *m, unsigned int reference, double *number)
{
    int status = GOOD;
    if (reference >= N_VALUES)
        return refuse(m, "expected a value reference below %d, got %u", (int)N_VALUES, reference);
#if MODEL_IS_DISCRETE
    if (reference >= FIRST_Y)
        status = know_outputs(m);
#else
    if (reference >= FIRST_Z)
        status = know_indicators(m);
    else if (reference >= FIRST_Y)
        status = know_outputs(m);
    else if (reference >= FIRST_DX)
        status = know_rates(m);
    else if (reference >= FIRST_X)
        status = know_constants(m);
#endif
    *number = m->s.value[reference];
    return status;
}

#if MODEL_IS_DISCRETE
/* Variables of each type are set and got by functions of their own. */
#define TYPED(name, Number, wanted)                                                                            \
    static int set_##name(Instance *m, const unsigned int *references, size_t count, const Number *numbers)     \
    {                                                                                                          \
        size_t k;                                                                                              \
        if (!may_call(m, "Set", LIVING & ~TERMINATED))                                                         \
            return BAD;                                                                                        \
        for (k = 0; k < count; k++)                                                                            \
            if (!has_type(m, references[k], wanted) || set_value(m, references[k], (double)numbers[k]))         \
                return BAD;                                                                                    \
        return GOOD;                                                                                           \
    }                                                                                                          \
    static int get_##name(Instance *m, const unsigned int *references, size_t count, Number *numbers)           \
    {                                                                                                          \
        double number = 0.0;                                                                                   \
        size_t k;                                                                                              \
        if (!may_call(m, "Get", LIVING | FAILED))                                                              \
            return BAD;                                                                                        \
        for (k = 0; k < count; k++) {                                                                          \
            if (!has_type(m, references[k], wanted) || get_value(m, references[k], &number))                    \
                return BAD;                                                                                    \
            numbers[k] = (Number)number;                                                                       \
        }                                                                                                      \
        return GOOD;                                                                                           \
    }

static int has_type(Instance *m, unsigned int reference, Type wanted)
{
    if (reference < N_VALUES && variables[reference].type == wanted)
        return 1;
    tell(m, BAD, "logStatusError", "value reference %u: expected a variable of the type that the function is for", reference);
    return 0;
}

TYPED(values, double, REAL)
#if FMI_VERSION == 2
TYPED(integers, fmi2Integer, INTEGER)
TYPED(booleans, fmi2Boolean, BOOLEAN)
#else
TYPED(integers, fmi3Int32, INTEGER)
TYPED(booleans, fmi3Boolean, BOOLEAN)
#endif
#else
static int set_values(Instance *m, const unsigned int *references, size_t count, const double *numbers)
{
    size_t k;
    if (!may_call(m, "Set", LIVING & ~TERMINATED))
        return BAD;
    for (k = 0; k < count; k++)
        if (set_value(m, references[k], numbers[k]))
            return BAD;
    return GOOD;
}

static int get_values(Instance *m, const unsigned int *references, size_t count, double *numbers)
{
    size_t k;
    if (!may_call(m, "Get", LIVING | FAILED))
        return BAD;
    for (k = 0; k < count; k++)
        if (get_value(m, references[k], numbers + k))
            return BAD;
    return GOOD;
}

typedef struct {
    double du[N_U], dx[N_X], drates[N_X], dy[N_Y];
} Seeds;

/* Where the seed or the sensitivity of a reference stands; unknowns are derivatives and outputs, states among them. */
static double *place_of(Seeds *d, unsigned int reference, int is_unknown)
{
    if (reference >= FIRST_X && reference < FIRST_DX)
        return d->dx + (reference - FIRST_X);
    if (is_unknown && reference >= FIRST_DX && reference < FIRST_Y)
        return d->drates + (reference - FIRST_DX);
    if (is_unknown && reference >= FIRST_Y && reference < FIRST_Z)
        return d->dy + (reference - FIRST_Y);
    if (!is_unknown && reference >= FIRST_U && reference < FIRST_X)
        return d->du + (reference - FIRST_U);
    return NULL;
}

/* sensitivity = J seed, or its transpose times seed. The rate of a resting state is 0 whatever its input. */
static int differentiate(Instance *m, const unsigned int *unknowns, size_t n_unknowns, const unsigned int *knowns,
                         size_t n_knowns, const double *seed, double *sensitivity, int is_adjoint)
{
    State *s = &m->s;
    Seeds d;
    double inside[N_X];
    size_t k;
    int n;
    memset(&d, 0, sizeof d);
    if (!may_call(m, "Derivative", INITIALIZING | RUNNING | TERMINATED) || know_rates(m))
        return BAD;
    keep_within(s, part(s, FIRST_X), inside);
    for (k = 0; k < n_unknowns; k++)
        if (!place_of(&d, unknowns[k], 1))
            return refuse(m, "expected an output or a derivative as unknown, got value reference %u", unknowns[k]);
    for (k = 0; k < n_knowns; k++)
        if (!place_of(&d, knowns[k], 0))
            return refuse(m, "expected an input or a state as known, got value reference %u", knowns[k]);
    for (k = 0; k < (is_adjoint ? n_unknowns : n_knowns); k++)
        *place_of(&d, is_adjoint ? unknowns[k] : knowns[k], is_adjoint) += seed[k];
    if (is_adjoint) {
        for (n = 0; n < N_X; n++)
            if (s->mode[n])
                d.drates[n] = 0.0;
        model_adjoint(part(s, FIRST_P), s->constant, part(s, FIRST_U), inside, d.drates, d.dy, d.du, d.dx);
    } else {
        model_forward(part(s, FIRST_P), s->constant, part(s, FIRST_U), inside, d.du, d.dx, d.drates, d.dy);
        for (n = 0; n < N_X; n++)
            if (s->mode[n])
                d.drates[n] = 0.0;
    }
    for (k = 0; k < (is_adjoint ? n_knowns : n_unknowns); k++)
        sensitivity[k] = *place_of(&d, is_adjoint ? knowns[k] : unknowns[k], !is_adjoint);
    return GOOD;
}
#endif

/* What follows takes no time, but most of the library's room. */
#if defined(__clang__)
#pragma clang attribute push(__attribute__((minsize)), apply_to = function)
#elif defined(__GNUC__)
#pragma GCC optimize("Os")
#endif

/* --------------------------------------------------------------------------------------------------- an instance's life */

static void restart(Instance *m)
{
    const signed char is_cosimulation = m->s.is_cosimulation;
    int k;
    memset(&m->s, 0, sizeof m->s);
    for (k = 0; k < N_VALUES; k++)
        m->s.value[k] = variables[k].start;
    m->s.is_cosimulation = is_cosimulation;
#if !MODEL_IS_DISCRETE
    m->s.tolerance = TOLERANCE;
#endif
    m->s.phase = CREATED;
}

/* `m` knows where to log; it is taken over, and freed if it cannot become an instance. */
static Instance *create(Instance *m, const char *name, const char *token, int is_cosimulation, int is_talkative)
{
    if (!m)
        return NULL;
    m->is_talkative = is_talkative;
    m->name = calloc(1, name ? strlen(name) + 1 : 1);
    if (m->name && name)
        strcpy(m->name, name);
    m->s.is_cosimulation = (signed char)is_cosimulation;
#if MODEL_IS_DISCRETE
    if (m->name && !is_cosimulation) {
        tell(m, BAD, "logStatusError", "expected an instance for co-simulation, got model exchange");
        free(m->name);
        free(m);
        return NULL;
    }
#endif
    if (!m->name || !token || strcmp(token, MODEL_TOKEN)) {
        tell(m, BAD, "logStatusError", "expected the token %s, got %.60s", MODEL_TOKEN, token ? token : "none");
        free(m->name);
        free(m);
        return NULL;
    }
    restart(m);
    return m;
}

static void destroy(Instance *m)
{
    if (m)
        free(m->name);
    free(m);
}

static int set_up(Instance *m, int has_tolerance, double tolerance, double time)
{
    if (has_tolerance && !(tolerance > 0.0 && tolerance < 1.0))
        return refuse(m, "expected a tolerance between 0 and 1, got %g", tolerance);
    if (!isfinite(time))
        return refuse(m, "expected a finite start time, got %g", time);
#if !MODEL_IS_DISCRETE
    m->s.tolerance = has_tolerance ? tolerance : TOLERANCE;
#endif
    m->s.value[0] = time;
    return GOOD;
}

static int leave_initialization(Instance *m)
{
#if MODEL_IS_DISCRETE
    if (!may_call(m, "ExitInitializationMode", INITIALIZING) || know_constants(m))
        return BAD;
    m->s.phase = STEPPING;
#else
    int moved;
    if (!may_call(m, "ExitInitializationMode", INITIALIZING) || settle(m, &moved))
        return BAD;
    m->s.phase = m->s.is_cosimulation ? STEPPING : EVENT;
#endif
    return GOOD;
}

static int change_phase(Instance *m, const char *function, int from, int to)
{
    if (!may_call(m, function, from))
        return BAD;
    m->s.phase = (signed char)to;
    return GOOD;
}

static Label own_label(void)
{
    Label label;
    memset(&label, 0, sizeof label);
    memcpy(label.magic, "ohmloom", 8);
    label.format = 1;
    label.size = sizeof(State);
    memcpy(label.token, MODEL_TOKEN, sizeof MODEL_TOKEN);
    return label;
}

static int is_own(Instance *m, const Snapshot *snapshot)
{
    const Label label = own_label();
    if (!memcmp(&label, &snapshot->label, sizeof label))
        return 1;
    tell(m, BAD, "logStatusError", "expected a state of this very FMU, got one of another version or model");
    return 0;
}

static int save_state(Instance *m, void **handle)
{
    Snapshot *snapshot = *handle;
    if (snapshot && !is_own(m, snapshot))
        return BAD;
    if (!snapshot && !(snapshot = calloc(1, sizeof *snapshot)))
        return refuse(m, "expected memory for a state, got none");
    snapshot->label = own_label();
    memcpy(&snapshot->s, &m->s, sizeof m->s);
    *handle = snapshot;
    return GOOD;
}

static int load_state(Instance *m, void *handle)
{
    const signed char is_cosimulation = m->s.is_cosimulation;
    const Snapshot *snapshot = handle;
    if (!snapshot || !is_own(m, snapshot))
        return BAD;
    if (snapshot->s.is_cosimulation != is_cosimulation)
        return refuse(m, "expected a state of the same interface, got one of the other");
    memcpy(&m->s, &snapshot->s, sizeof m->s);
    return GOOD;
}

static int write_state(Instance *m, const void *handle, char *bytes, size_t size)
{
    if (!handle || !is_own(m, handle) || size < sizeof(Snapshot))
        return refuse(m, "expected a state and room for %d bytes, got %d", (int)sizeof(Snapshot), (int)size);
    memcpy(bytes, handle, sizeof(Snapshot));
    return GOOD;
}

static int read_state(Instance *m, const char *bytes, size_t size, void **handle)
{
    Snapshot *snapshot;
    if (size != sizeof *snapshot)
        return refuse(m, "expected %d bytes of a state of this very FMU, got %d", (int)sizeof *snapshot, (int)size);
    if (!(snapshot = malloc(sizeof *snapshot)))
        return refuse(m, "expected memory for a state, got none");
    memcpy(snapshot, bytes, sizeof *snapshot);
    if (!is_own(m, snapshot)) {
        free(snapshot);
        return BAD;
    }
    *handle = snapshot;
    return GOOD;
}

#if !MODEL_IS_DISCRETE
static int set_states(Instance *m, const double *x, size_t count)
{
    size_t k;
    if (!may_call(m, "SetContinuousStates", CONTINUOUS | EVENT) || count != N_X)
        return BAD;
    for (k = 0; k < count; k++)
        if (!isfinite(x[k]))
            return refuse(m, "%s: expected a finite number, got %g", variables[FIRST_X + k].name, x[k]);
    memcpy(m->s.value + FIRST_X, x, sizeof(double) * N_X);
    m->s.rates_known = m->s.outputs_known = 0;
    return GOOD;
}
#endif

static int not_offered(Instance *m, const char *function) { return refuse(m, "%s: not offered", function); }

static int no_variables(Instance *m, size_t count, const char *function)
{
    return count ? refuse(m, "%s: this FMU has no variables of this type", function) : GOOD;
}

#if !MODEL_IS_DISCRETE
static int set_time(Instance *m, double time)
{
    if (!may_call(m, "SetTime", EVENT | CONTINUOUS))
        return BAD;
    m->s.value[0] = time;
    return GOOD;
}

/* A block of the value table, as model exchange asks for it. */
static int get_block(Instance *m, unsigned int first, size_t wanted, double *numbers, size_t count)
{
    size_t k;
    if (!may_call(m, "Get", INITIALIZING | RUNNING | TERMINATED) || count != wanted)
        return BAD;
    for (k = 0; k < count; k++)
        if (get_value(m, first + (unsigned int)k, numbers + k))
            return BAD;
    return GOOD;
}

static int get_nominals(Instance *m, double *nominals, size_t count)
{
    size_t k;
    if (count != N_X || know_constants(m))
        return BAD;
    for (k = 0; k < count; k++)
        nominals[k] = range_of(&m->s, (int)k);
    return GOOD;
}
#endif

/* The standard's functions have arguments for which these FMUs have no use. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* ------------------------------------------------------------------------------------------- what FMI 2.0 calls all this */

#if FMI_VERSION == 2
#define M ((Instance *)c)
#define STATUS(expression) ((fmi2Status)(expression))

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean is_talkative)
{
    Instance *m = calloc(1, sizeof *m);
    if (m)
        m->host = host;
    return create(m, name, token, type == fmi2CoSimulation, is_talkative);
}

void fmi2FreeInstance(fmi2Component c) { destroy(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    M->is_talkative = on;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
    return STATUS(may_call(M, "SetupExperiment", CREATED) ? set_up(M, has_tolerance, tolerance, start) : BAD);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return STATUS(change_phase(M, "EnterInitializationMode", CREATED, INITIALIZING));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return STATUS(leave_initialization(M)); }

fmi2Status fmi2Terminate(fmi2Component c)
{
    return STATUS(change_phase(M, "Terminate", RUNNING, TERMINATED));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    restart(M);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
{
    return STATUS(get_values(M, r, n, v));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[])
{
    return STATUS(set_values(M, r, n, v));
}

#define NO_VARIABLES(Type)                                                                                     \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##Type v[])           \
    {                                                                                                          \
        return STATUS(no_variables(M, n, "Get" #Type));                                                        \
    }                                                                                                          \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##Type v[])     \
    {                                                                                                          \
        return STATUS(no_variables(M, n, "Set" #Type));                                                        \
    }
#if MODEL_IS_DISCRETE
#define VARIABLES(Type, name)                                                                                  \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##Type v[])           \
    {                                                                                                          \
        return STATUS(get_##name(M, r, n, v));                                                                 \
    }                                                                                                          \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##Type v[])     \
    {                                                                                                          \
        return STATUS(set_##name(M, r, n, v));                                                                 \
    }
VARIABLES(Integer, integers)
VARIABLES(Boolean, booleans)
#else
NO_VARIABLES(Integer)
NO_VARIABLES(Boolean)
#endif
NO_VARIABLES(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { return STATUS(save_state(M, state)); }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return STATUS(load_state(M, state)); }

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    *size = sizeof(Snapshot);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return STATUS(write_state(M, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return STATUS(read_state(M, bytes, size, state));
}

#if MODEL_IS_DISCRETE
#define NOT_OFFERED(Name, ...)                                                                                 \
    fmi2Status fmi2##Name(fmi2Component c, __VA_ARGS__) { return STATUS(not_offered(M, #Name)); }
NOT_OFFERED(GetDirectionalDerivative, const fmi2ValueReference unknowns[], size_t n_unknowns,
            const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[], fmi2Real sensitivity[])
/* Some importers ask for these even where there is no model exchange. */
NOT_OFFERED(NewDiscreteStates, fmi2EventInfo *info)
NOT_OFFERED(CompletedIntegratorStep, fmi2Boolean is_final, fmi2Boolean *event, fmi2Boolean *stop)
NOT_OFFERED(SetTime, fmi2Real time)
NOT_OFFERED(SetContinuousStates, const fmi2Real x[], size_t n)
NOT_OFFERED(GetDerivatives, fmi2Real rates[], size_t n)
NOT_OFFERED(GetEventIndicators, fmi2Real z[], size_t n)
NOT_OFFERED(GetContinuousStates, fmi2Real x[], size_t n)
NOT_OFFERED(GetNominalsOfContinuousStates, fmi2Real nominals[], size_t n)

fmi2Status fmi2EnterEventMode(fmi2Component c) { return STATUS(not_offered(M, "EnterEventMode")); }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return STATUS(not_offered(M, "EnterContinuousTimeMode")); }
#else
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[])
{
    return STATUS(differentiate(M, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity, 0));
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    return STATUS(change_phase(M, "EnterEventMode", CONTINUOUS | EVENT, EVENT));
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    int moved;
    memset(info, 0, sizeof *info);
    if (!may_call(M, "NewDiscreteStates", EVENT) || settle(M, &moved))
        return fmi2Error;
    info->valuesOfContinuousStatesChanged = moved > 0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    return STATUS(change_phase(M, "EnterContinuousTimeMode", EVENT, CONTINUOUS));
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean is_final, fmi2Boolean *event, fmi2Boolean *stop)
{
    *event = *stop = fmi2False;
    return STATUS(change_phase(M, "CompletedIntegratorStep", CONTINUOUS, CONTINUOUS));
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) { return STATUS(set_time(M, time)); }

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) { return STATUS(set_states(M, x, n)); }

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rates[], size_t n)
{
    return STATUS(get_block(M, FIRST_DX, N_X, rates, n));
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n)
{
    return STATUS(get_block(M, FIRST_Z, N_Z, z, n));
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    return STATUS(get_block(M, FIRST_X, N_X, x, n));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n)
{
    return STATUS(get_nominals(M, nominals, n));
}
#endif

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real v[])
{
    return STATUS(not_offered(M, "SetRealInputDerivatives"));
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real v[])
{
    return STATUS(not_offered(M, "GetRealOutputDerivatives"));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real duration, fmi2Boolean is_final)
{
    return STATUS(step(M, time, duration));
}

fmi2Status fmi2CancelStep(fmi2Component c) { return STATUS(not_offered(M, "CancelStep")); }

#define NO_STATUS(Name, Type)                                                                                  \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2StatusKind kind, Type *v)                               \
    {                                                                                                          \
        not_offered(M, "Get" #Name);                                                                           \
        return fmi2Discard;                                                                                    \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)
#endif

/* ------------------------------------------------------------------------------------------- what FMI 3.0 calls all this */

#if FMI_VERSION == 3
#define M ((Instance *)c)
#define STATUS(expression) ((fmi3Status)(expression))
#define REFS const fmi3ValueReference r[], size_t n

const char *fmi3GetVersion(void) { return fmi3Version; }

static Instance *create3(fmi3String name, fmi3String token, int is_cosimulation, int is_talkative, void *environment,
                         fmi3LogMessageCallback log)
{
    Instance *m = calloc(1, sizeof *m);
    if (m) {
        m->log = log;
        m->environment = environment;
    }
    return create(m, name, token, is_cosimulation, is_talkative);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean is_talkative, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    return create3(name, token, 0, is_talkative, environment, log);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean is_talkative, fmi3Boolean uses_events, fmi3Boolean may_return_early,
                                         REFS, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    return create3(name, token, 1, is_talkative, environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean is_talkative,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    if (log)
        log(environment, fmi3Error, "logStatusError", "InstantiateScheduledExecution: not offered");
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c) { destroy(c); }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    M->is_talkative = on;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    if (!may_call(M, "EnterInitializationMode", CREATED) || set_up(M, has_tolerance, tolerance, start))
        return fmi3Error;
    M->s.phase = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return STATUS(leave_initialization(M)); }

#if MODEL_IS_DISCRETE
fmi3Status fmi3EnterEventMode(fmi3Instance c) { return STATUS(not_offered(M, "EnterEventMode")); }
#else
fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    return STATUS(change_phase(M, "EnterEventMode", CONTINUOUS | EVENT, EVENT));
}
#endif

fmi3Status fmi3Terminate(fmi3Instance c)
{
    return STATUS(change_phase(M, "Terminate", RUNNING, TERMINATED));
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    restart(M);
    return fmi3OK;
}

#if MODEL_HAS_ARRAYS
/* References of the elements of all these variables, in order; the first one's is that of its array. NULL where they are
 * not as many as the values, or one is none; freed by the one who asked for it. */
static unsigned int *elements_of(Instance *m, REFS, size_t n_values)
{
    unsigned int *all = malloc((n_values + 1) * sizeof *all);
    size_t k, j, count = 0;
    for (k = 0; all && k < n; k++) {
        size_t size = 1;
        for (j = 0; j < sizeof arrays / sizeof *arrays; j++)
            if (r[k] >= arrays[j].first && r[k] - arrays[j].first < arrays[j].size)
                size = r[k] == arrays[j].first ? arrays[j].size : 0;
        if (!size || size > n_values - count)
            break;
        for (j = 0; j < size; j++)
            all[count++] = r[k] + (unsigned int)j;
    }
    if (all && k == n && count == n_values)
        return all;
    tell(m, BAD, "logStatusError", "expected variables of %d values together, got others", (int)n_values);
    free(all);
    return NULL;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, REFS, fmi3Float64 v[], size_t n_values)
{
    unsigned int *all = elements_of(M, r, n, n_values);
    const int status = all ? get_values(M, all, n_values, v) : BAD;
    free(all);
    return STATUS(status);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, REFS, const fmi3Float64 v[], size_t n_values)
{
    unsigned int *all = elements_of(M, r, n, n_values);
    const int status = all ? set_values(M, all, n_values, v) : BAD;
    free(all);
    return STATUS(status);
}
#else
fmi3Status fmi3GetFloat64(fmi3Instance c, REFS, fmi3Float64 v[], size_t n_values)
{
    return STATUS(n == n_values ? get_values(M, r, n, v) : refuse(M, "GetFloat64: expected as many values as references"));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, REFS, const fmi3Float64 v[], size_t n_values)
{
    return STATUS(n == n_values ? set_values(M, r, n, v) : refuse(M, "SetFloat64: expected as many values as references"));
}
#endif

/* Variables of other types, and what else FMI 3.0 has that these FMUs do not offer. */
#define NO_VARIABLES(Type)                                                                                     \
    fmi3Status fmi3Get##Type(fmi3Instance c, REFS, fmi3##Type v[], size_t n_values)                             \
    {                                                                                                          \
        return STATUS(no_variables(M, n, "Get" #Type));                                                        \
    }                                                                                                          \
    fmi3Status fmi3Set##Type(fmi3Instance c, REFS, const fmi3##Type v[], size_t n_values)                       \
    {                                                                                                          \
        return STATUS(no_variables(M, n, "Set" #Type));                                                        \
    }
NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
#if MODEL_IS_DISCRETE
#define VARIABLES(Type, name)                                                                                  \
    fmi3Status fmi3Get##Type(fmi3Instance c, REFS, fmi3##Type v[], size_t n_values)                             \
    {                                                                                                          \
        return STATUS(n == n_values ? get_##name(M, r, n, v) : refuse(M, "Get" #Type ": expected one value each"));\
    }                                                                                                          \
    fmi3Status fmi3Set##Type(fmi3Instance c, REFS, const fmi3##Type v[], size_t n_values)                       \
    {                                                                                                          \
        return STATUS(n == n_values ? set_##name(M, r, n, v) : refuse(M, "Set" #Type ": expected one value each"));\
    }
VARIABLES(Int32, integers)
VARIABLES(Boolean, booleans)
#else
NO_VARIABLES(Int32)
NO_VARIABLES(Boolean)
#endif
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(String)

#define NOT_OFFERED(Name, ...)                                                                                 \
    fmi3Status fmi3##Name(fmi3Instance c, __VA_ARGS__) { return STATUS(not_offered(M, #Name)); }
NOT_OFFERED(GetBinary, REFS, size_t sizes[], fmi3Binary v[], size_t n_values)
NOT_OFFERED(SetBinary, REFS, const size_t sizes[], const fmi3Binary v[], size_t n_values)
NOT_OFFERED(GetClock, REFS, fmi3Clock v[])
NOT_OFFERED(SetClock, REFS, const fmi3Clock v[])
NOT_OFFERED(GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *count)
NOT_OFFERED(GetVariableDependencies, fmi3ValueReference r, size_t elements[], fmi3ValueReference independents[],
            size_t independent_elements[], fmi3DependencyKind kinds[], size_t count)
NOT_OFFERED(GetIntervalDecimal, REFS, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(GetIntervalFraction, REFS, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(GetShiftDecimal, REFS, fmi3Float64 shifts[])
NOT_OFFERED(GetShiftFraction, REFS, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NOT_OFFERED(SetIntervalDecimal, REFS, const fmi3Float64 intervals[])
NOT_OFFERED(SetIntervalFraction, REFS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_OFFERED(SetShiftDecimal, REFS, const fmi3Float64 shifts[])
NOT_OFFERED(SetShiftFraction, REFS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_OFFERED(GetOutputDerivatives, REFS, const fmi3Int32 orders[], fmi3Float64 v[], size_t n_values)
NOT_OFFERED(ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return STATUS(not_offered(M, "EnterConfigurationMode")); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return STATUS(not_offered(M, "ExitConfigurationMode")); }
fmi3Status fmi3EnterStepMode(fmi3Instance c) { return STATUS(not_offered(M, "EnterStepMode")); }

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { return STATUS(save_state(M, state)); }
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) { return STATUS(load_state(M, state)); }

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    *size = sizeof(Snapshot);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return STATUS(write_state(M, state, (char *)bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return STATUS(read_state(M, (const char *)bytes, size, state));
}

#if MODEL_IS_DISCRETE
NOT_OFFERED(GetDirectionalDerivative, REFS, const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
            size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
NOT_OFFERED(GetAdjointDerivative, REFS, const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
            size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
NOT_OFFERED(UpdateDiscreteStates, fmi3Boolean *again, fmi3Boolean *stop, fmi3Boolean *nominals_changed,
            fmi3Boolean *states_changed, fmi3Boolean *has_next, fmi3Float64 *next)

/* Some importers ask for these even where there is no model exchange. */
NOT_OFFERED(CompletedIntegratorStep, fmi3Boolean is_final, fmi3Boolean *event, fmi3Boolean *stop)
NOT_OFFERED(SetTime, fmi3Float64 time)
NOT_OFFERED(SetContinuousStates, const fmi3Float64 x[], size_t n)
NOT_OFFERED(GetContinuousStateDerivatives, fmi3Float64 rates[], size_t n)
NOT_OFFERED(GetEventIndicators, fmi3Float64 z[], size_t n)
NOT_OFFERED(GetContinuousStates, fmi3Float64 x[], size_t n)
NOT_OFFERED(GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t n)
NOT_OFFERED(GetNumberOfEventIndicators, size_t *count)
NOT_OFFERED(GetNumberOfContinuousStates, size_t *count)

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return STATUS(not_offered(M, "EnterContinuousTimeMode")); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return STATUS(not_offered(M, "EvaluateDiscreteStates")); }
#else
#if MODEL_HAS_ARRAYS
static int differentiate_arrays(Instance *m, const unsigned int *unknowns, size_t n_unknowns, size_t unknown_values,
                                const unsigned int *knowns, size_t n_knowns, size_t known_values, const double *seed,
                                double *sensitivity, int is_adjoint)
{
    unsigned int *rows = elements_of(m, unknowns, n_unknowns, unknown_values);
    unsigned int *columns = elements_of(m, knowns, n_knowns, known_values);
    int status = BAD;
    if (rows && columns)
        status = differentiate(m, rows, unknown_values, columns, known_values, seed, sensitivity, is_adjoint);
    free(rows);
    free(columns);
    return status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    return STATUS(differentiate_arrays(M, unknowns, n_unknowns, n_sensitivity, knowns, n_knowns, n_seed, seed,
                                       sensitivity, 0));
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    return STATUS(differentiate_arrays(M, unknowns, n_unknowns, n_seed, knowns, n_knowns, n_sensitivity, seed,
                                       sensitivity, 1));
}
#else
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    if (n_seed != n_knowns || n_sensitivity != n_unknowns)
        return STATUS(refuse(M, "GetDirectionalDerivative: expected as many numbers as references"));
    return STATUS(differentiate(M, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity, 0));
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    if (n_seed != n_unknowns || n_sensitivity != n_knowns)
        return STATUS(refuse(M, "GetAdjointDerivative: expected as many numbers as references"));
    return STATUS(differentiate(M, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity, 1));
}
#endif

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return fmi3OK; }

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *stop, fmi3Boolean *nominals_changed,
                                    fmi3Boolean *states_changed, fmi3Boolean *has_next, fmi3Float64 *next)
{
    int moved;
    *again = *stop = *nominals_changed = *states_changed = *has_next = fmi3False;
    *next = 0.0;
    if (!may_call(M, "UpdateDiscreteStates", EVENT) || settle(M, &moved))
        return fmi3Error;
    *states_changed = moved > 0;
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    return STATUS(change_phase(M, "EnterContinuousTimeMode", EVENT, CONTINUOUS));
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean is_final, fmi3Boolean *event, fmi3Boolean *stop)
{
    *event = *stop = fmi3False;
    return STATUS(change_phase(M, "CompletedIntegratorStep", CONTINUOUS, CONTINUOUS));
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) { return STATUS(set_time(M, time)); }
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) { return STATUS(set_states(M, x, n)); }

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 rates[], size_t n)
{
    return STATUS(get_block(M, FIRST_DX, N_X, rates, n));
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n)
{
    return STATUS(get_block(M, FIRST_Z, N_Z, z, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    return STATUS(get_block(M, FIRST_X, N_X, x, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
{
    return STATUS(get_nominals(M, nominals, n));
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *count)
{
    *count = N_Z;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *count)
{
    *count = N_X;
    return fmi3OK;
}
#endif

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 duration, fmi3Boolean is_final, fmi3Boolean *event,
                      fmi3Boolean *stop, fmi3Boolean *early, fmi3Float64 *reached)
{
    const int status = step(M, time, duration);
    *event = *stop = *early = fmi3False;
    *reached = status ? time : time + duration;
    return STATUS(status);
}
#endif

#if defined(__clang__)
#pragma clang attribute pop
#endif
