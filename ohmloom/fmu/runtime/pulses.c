/*
 * Pulses on devices whose laws have no closed forms: ds/dx = f(s), x the charge or the time, beside a running integral
 * of h(s), by three-stage Gauss collocation, the operations of ohmloom's own integrator in their order. At a wall the state
 * stops, and charge still passes. die.c has conductance_at() [S] and charge_rate_at() [A] of a tile's devices.
 */

enum { OVER_CHARGE, OVER_TIME, HELD }; /* a voltage until a charge has passed; a current, a voltage for a time */

#define R 3.872983346207417 /* sqrt(15): the nodes' offsets are +-sqrt(15)/10 */
static const double A[3][3] = {
    {5.0 / 36.0, 2.0 / 9.0 - R / 15.0, 5.0 / 36.0 - R / 30.0},
    {5.0 / 36.0 + R / 24.0, 2.0 / 9.0, 5.0 / 36.0 - R / 24.0},
    {5.0 / 36.0 + R / 30.0, 2.0 / 9.0 + R / 15.0, 5.0 / 36.0},
};
static const double B[3] = {5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0};
static const double E[3] = {5.0 / 6.0 + R / 6.0, -2.0 / 3.0, 5.0 / 6.0 - R / 6.0}; /* rates, taken back to the start */

#define ROUGH 3e-7             /* relative, of the integral of h by Simpson's rule */
#define STEP_CHANGE (1.0 / 32.0) /* of s in one step */
#define WALL 4.5e-16           /* distance that counts as being there */
#define ROUNDS 12
#define SETTLED_RATES 4e-16
#define RELAXED 1e-12          /* the same for Newton's rule */
#define SHIFT 1e-6
#define STRAIN 1e-5            /* roughness of s, of its change, */
#define LOOSE 1e-10            /* and always */
#define STILL 1e-18            /* a change of s that is none */

typedef struct {
    double rate, integrand;
} Slopes;

typedef struct {
    double change, strain, part, middle;
    int is_settled;
} Step;

/* What solves i = G(s, v) v: as G rises with v, bisection is safe. */
static double port_voltage(int t, double s, double i)
{
    const double low_field = conductance_at(t, s, 0.0);
    double high = i / low_field, low;
    const double g = conductance_at(t, s, high);
    int round;
    if (g == low_field)
        return high;
    low = i / g;
    for (round = 0; round < 2000; round++) {
        const double v = 0.5 * (low + high);
        if (v == low || v == high)
            break;
        if (fabs(conductance_at(t, s, v) * v) > fabs(i))
            high = v;
        else
            low = v;
    }
    return high;
}

static Slopes slopes(int kind, int t, double s, double drive)
{
    const double q_d = tile_charge[t];
    Slopes found;
    if (kind == OVER_TIME) {
        const double v = port_voltage(t, s, drive);
        found.rate = charge_rate_at(t, s, v, drive) / q_d;
        found.integrand = v * drive;
    } else {
        const double i = conductance_at(t, s, drive) * drive;
        found.rate = kind == HELD ? charge_rate_at(t, s, drive, i) / q_d
                                  : charge_rate_at(t, s, drive, i) / fabs(i) / q_d;
        found.integrand = kind == HELD ? i : 1.0 / fabs(i);
    }
    return found;
}

/* Rates g and integrands y at the three stages of a step, whose rates so far are f. */
static void look_at_stages(int kind, int t, double s, double drive, double span, const double *f, double *g, double *y)
{
    int k;
    for (k = 0; k < 3; k++) {
        const double x = s + span * (A[k][0] * f[0] + A[k][1] * f[1] + A[k][2] * f[2]);
        const Slopes at = slopes(kind, t, fmin(fmax(x, 0.0), 1.0), drive);
        g[k] = at.rate;
        y[k] = at.integrand;
    }
}

static double largest_of(double a, double b, double c) { return fmax(fmax(a, b), c); }

/* The stages' rates f by simplified Newton iteration, its slope from a difference; whether they have settled. */
static int relax(int kind, int t, double s, double drive, double span, double rate, double *f, double *y)
{
    const double shift = s < 0.5 ? SHIFT : -SHIFT;
    const double z = span * (slopes(kind, t, s + shift, drive).rate - rate) / shift;
    const double m11 = 1.0 - z * A[0][0], m12 = -z * A[0][1], m13 = -z * A[0][2];
    const double m21 = -z * A[1][0], m22 = 1.0 - z * A[1][1], m23 = -z * A[1][2];
    const double m31 = -z * A[2][0], m32 = -z * A[2][1], m33 = 1.0 - z * A[2][2];
    const double c11 = m22 * m33 - m23 * m32, c12 = m23 * m31 - m21 * m33, c13 = m21 * m32 - m22 * m31;
    const double determinant = m11 * c11 + m12 * c12 + m13 * c13;
    int round, k;
    for (k = 0; k < 3; k++) {
        f[k] = z < 0.0 ? rate / (1.0 - 0.5 * z) : rate;
        y[k] = 0.0;
    }
    for (round = 0; round < ROUNDS; round++) {
        double g[3], r1, r2, r3, d1, d2, d3, moved;
        look_at_stages(kind, t, s, drive, span, f, g, y);
        r1 = g[0] - f[0], r2 = g[1] - f[1], r3 = g[2] - f[2];
        d1 = (c11 * r1 + (m13 * m32 - m12 * m33) * r2 + (m12 * m23 - m13 * m22) * r3) / determinant;
        d2 = (c12 * r1 + (m11 * m33 - m13 * m31) * r2 + (m13 * m21 - m11 * m23) * r3) / determinant;
        d3 = (c13 * r1 + (m12 * m31 - m11 * m32) * r2 + (m11 * m22 - m12 * m21) * r3) / determinant;
        f[0] += d1, f[1] += d2, f[2] += d3;
        moved = largest_of(fabs(d1), fabs(d2), fabs(d3));
        if (moved <= RELAXED * largest_of(fabs(rate), fabs(f[0]), fabs(f[2])) || moved * span <= STILL)
            return 1;
    }
    return 0;
}

static Step collocate(int kind, int t, double s, double drive, double span, double rate, int *is_stiff)
{
    double f[3] = {rate, rate, rate}, y[3] = {0.0, 0.0, 0.0};
    Step step;
    int round, k, is_settled = 0;
    for (round = 0; !is_settled && round < (*is_stiff ? 0 : ROUNDS); round++) {
        double g[3], moved;
        look_at_stages(kind, t, s, drive, span, f, g, y);
        moved = largest_of(fabs(g[0] - f[0]), fabs(g[1] - f[1]), fabs(g[2] - f[2]));
        is_settled = moved <= SETTLED_RATES * largest_of(fabs(rate), fabs(g[0]), fabs(g[2])) || moved * span <= STILL;
        for (k = 0; k < 3; k++)
            f[k] = g[k];
    }
    if (!is_settled) {
        *is_stiff = 1; /* where the state relaxes faster than the step, only Newton's rule converges */
        is_settled = relax(kind, t, s, drive, span, rate, f, y);
    }
    step.change = span * (B[0] * f[0] + B[1] * f[1] + B[2] * f[2]);
    step.part = span * (B[0] * y[0] + B[1] * y[1] + B[2] * y[2]);
    step.strain = span * fabs(E[0] * f[0] + E[1] * f[1] + E[2] * f[2] - rate);
    step.middle = y[1];
    step.is_settled = is_settled;
    return step;
}

/* The state after `span` of charge or time; the integral of h: time, energy or charge. */
static double pulse(int kind, int t, double s, double drive, double span, double *integral)
{
    const double start = s;
    double moved = 0.0, total = 0.0, left = span, size = span;
    Slopes now = slopes(kind, t, s, drive);
    int is_stiff = 0;
    while (left > 0.0) {
        const double reach = now.rate > 0.0 ? 1.0 - s : s;
        double end, rough, allowed, scale;
        int can_shrink;
        Slopes after;
        Step step;
        if (!(fabs(now.rate) < INFINITY)) {
            *integral = NAN;
            return NAN;
        }
        if (now.rate == 0.0 || reach <= WALL) {
            s = now.rate > 0.0 ? 1.0 : now.rate < 0.0 ? 0.0 : s;
            *integral = total + slopes(kind, t, s, drive).integrand * left;
            return s;
        }
        size = fmin(fmin(left, size), fmin(reach, STEP_CHANGE) / fabs(now.rate));
        step = collocate(kind, t, s, drive, size, now.rate, &is_stiff);
        can_shrink = size * fabs(now.rate) > STILL;
        if (!step.is_settled && can_shrink) {
            size *= 0.5;
            continue;
        }
        if (fabs(step.change) > reach + WALL) {
            size *= reach / fabs(step.change); /* a rate that grows along the step overshoots: land on the wall */
            continue;
        }
        end = fmin(fmax(start + (moved + step.change), 0.0), 1.0);
        after = slopes(kind, t, end, drive);
        rough = fabs((now.integrand + 4.0 * step.middle + after.integrand) * size / 6.0 - step.part);
        allowed = ROUGH * fabs(step.part);
        scale = rough <= 0.04 * allowed ? 2.0 : 0.9 * pow(allowed / rough, 0.25);
        if (is_stiff) {
            step.strain /= STRAIN * fabs(step.change) + LOOSE;
            scale = fmin(scale, step.strain <= 0.04 ? 2.0 : 0.9 * pow(1.0 / step.strain, 0.25));
            rough = fmax(rough, step.strain * allowed);
        }
        if (rough > allowed && can_shrink) {
            size *= fmax(scale, 0.1);
            continue;
        }
        moved += step.change; /* summed apart from s, so that many small steps round once */
        total += step.part;
        left -= size;
        size *= scale;
        s = end;
        now = after;
    }
    *integral = total;
    return s;
}
