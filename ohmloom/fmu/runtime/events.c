/*
 * How devices move. A state is an origin and a count of events since, which a wall takes over: an event is a thousandth
 * of the device's charge (the origin is a state), or, where the drive is by voltage, the flux of one pulse (the origin is
 * a flux). law.c has the laws, die.c the cells; flux() is the integral of 1/G over the charge. Devices of laws without these
 * closed forms are integrated (INTEGRATES); what else moves them counts in events of charge.
 */

#if INTEGRATES
#include "pulses.c"
#else
#define tile_is_integrated(t) ((void)(t), 0)
#endif

#if DRIVE != CHARGE || AGES
static double clamped(double s) { return s < 0.0 ? 0.0 : s > 1.0 ? 1.0 : s; }
#endif

#ifndef MOST_FLUX_ROUNDS
#define MOST_FLUX_ROUNDS 200
#endif

#if NEEDS_NEWTON
/* Newton's rule within a bracket, from s = 0, so that the answer depends on the flux alone; not a number if it fails. */
static double invert_flux(int t, double phi)
{
    double low = 0.0, high = 1.0, s = 0.0;
    int round;
    if (phi <= 0.0)
        return 0.0;
    if (phi >= flux(t, 1.0))
        return 1.0;
    for (round = 0; round < MOST_FLUX_ROUNDS; round++) {
        const double excess = flux(t, s) - phi, after = s - excess / (tile_charge[t] / conductance(t, s));
        if (excess > 0.0)
            high = s;
        else
            low = s;
        if (fabs(after - s) <= 1e-9 * after)
            return after;
        s = low < after && after < high ? after : 0.5 * (low + high);
    }
    return NAN;
}
#endif

#if DRIVE != CHARGE && !DRIVES_LINES
/* The state after a flux over a device and a resistance in series: phi(s') - phi(s) + R q_d (s' - s) is that flux. Not a
 * number if it is not found. */
static double state_behind(int t, double s, double series, double phi)
{
    const double q_d = tile_charge[t], start = flux(t, s);
    double low = phi > 0.0 ? s : 0.0, high = phi > 0.0 ? 1.0 : s, x = s;
    const double end = phi > 0.0 ? high : low;
    int round;
    if (fabs(flux(t, end) - start + series * q_d * (end - s)) <= fabs(phi))
        return end;
    for (round = 0; round < MOST_FLUX_ROUNDS; round++) {
        const double miss = flux(t, x) - start + series * q_d * (x - s) - phi;
        double after = x - miss / (q_d / conductance(t, x) + series * q_d);
        if (miss > 0.0)
            high = x;
        else
            low = x;
        if (!(low < after && after < high))
            after = 0.5 * (low + high);
        if (fabs(after - x) <= 1e-16)
            return after;
        x = after;
    }
    return NAN;
}
#endif

/* What a number of events makes of an origin and a count; the state. */
static double event_state(int t, double *origin, double *count)
{
    double x = *origin + *count / 1000.0, bottom = 0.0, top = 1.0;
#if DRIVE == VOLTAGE
    if (!tile_is_integrated(t))
        x = *origin + *count * tile_event_flux[t], bottom = tile_bottom[t], top = tile_top[t];
#else
    (void)t;
#endif
    if (x <= bottom || x >= top) {
        *origin = x <= bottom ? bottom : top;
        *count = 0.0;
        return x <= bottom ? 0.0 : 1.0;
    }
#if DRIVE == VOLTAGE
    if (!tile_is_integrated(t))
        return clamped(state_at_flux(t, x));
#endif
    return x;
}

static void read_cell(Controller *m, int k)
{
    const int t = cell_tile[k];
    m->g[k] = cell_is_live[k] ? conductance(t, m->s[k]) : cell_fixed[k];
#if !HAS_WIRES
    m->weight[k] = read_polarity[k] * weight_of(t, m->g[k], tile_reference[t]);
#endif
}

static void count_events(Controller *m, int k, double events)
{
    m->count[k] += events;
    m->s[k] = event_state(cell_tile[k], &m->origin[k], &m->count[k]);
    if (isnan(m->s[k]))
        m->failure = FLUX;
}

/* Of the next event of a cell, 1 nominally. */
static double event_size(const Controller *m, int k, double sign)
{
    const double size = cell_factor[k] * (1.0 + sign * ASYMMETRY);
#if HAS_CYCLE_NOISE
    const double noise = normal(CYCLE_KEY_LOW, CYCLE_KEY_HIGH, cell_number[k], m->pulses[k]);
    return size * fmax(1.0 + CYCLE_TO_CYCLE * noise, 0.0);
#else
    (void)m;
    return size;
#endif
}

/* Enters an event, of which this signed part was written. */
static void count_pulse(Controller *m, int k, double written)
{
#if HAS_CYCLE_NOISE
    m->pulses[k] += written != 0.0;
#else
    (void)m;
    (void)k;
    (void)written;
#endif
}

#if (DRIVE != CHARGE && !DRIVES_LINES) || AGES
/* A state that no count of events reaches. */
static void place_at(Controller *m, int k, double s)
{
    m->s[k] = clamped(s);
    if (isnan(s))
        m->failure = FLUX;
    m->count[k] = 0.0;
    m->origin[k] = m->s[k];
#if DRIVE == VOLTAGE
    if (!tile_is_integrated(cell_tile[k]))
        m->origin[k] = flux(cell_tile[k], m->s[k]);
#endif
}
#endif

#if INTEGRATES
/* Puts a cell where an integration ended. */
static void end_at(Controller *m, int k, double s)
{
    if (isnan(s))
        m->failure = PULSE;
    m->s[k] = m->origin[k] = clamped(s);
    m->count[k] = 0.0;
}

#if !DRIVES_LINES
/* One pulse of `size` events, of this share of the pulse's duration; wires enter by the voltage they leave at first. */
static void integrate_pulse(Controller *m, int k, double sign, double strength, double size, double width)
{
    const int t = cell_tile[k];
    const double left = strength * PULSE_VOLTAGE / (1.0 + cell_series[k] * m->g[k]);
    double integral, s;
#if DRIVE == VOLTAGE
    (void)width;
    s = pulse(HELD, t, m->s[k], sign * left, tile_duration[t] * size, &integral);
#else
    const double charge = size * tile_charge[t] / 1000.0;
#if IS_METERED
    (void)width;
    s = charge == 0.0 ? m->s[k] : pulse(OVER_CHARGE, t, m->s[k], sign * left, charge, &integral);
    if (METERING_DELAY > 0.0 && charge != 0.0) {
        const double more = METERING_DELAY * integral;
        s = pulse(HELD, t, s, sign * left, more, &integral);
    }
#else
    const double duration = tile_duration[t] * width;
    (void)left;
    s = pulse(OVER_TIME, t, m->s[k], sign * charge / duration, duration, &integral);
#endif
#endif
    end_at(m, k, s);
}
#endif
#endif

#if METERS_LATE
#define SMOOTH 0.05 /* relative change of G in an event up to which Simpson's rule serves */

/* The charge that still flows until the driver, which meters it, has switched off; in events. */
static double late_events(const Controller *m, int k, double before, double g_before, double strength, double size)
{
    const int t = cell_tile[k];
    const double after = m->s[k], voltage = strength * PULSE_VOLTAGE, series = cell_series[k];
    const double charge = size * tile_event_charge[t], inside = fabs(after - before) * tile_charge[t];
    const double g = conductance(t, after);
    double passed, duration; /* flux; time */
    if (fabs(g - g_before) > SMOOTH * g) {
        passed = fabs(flux(t, after) - flux(t, before));
    } else {
        const double middle = conductance(t, 0.5 * (before + after)), edges = g_before * g;
        passed = ((g_before + g) * middle + 4.0 * edges) / (edges * middle) * (1.0 / 6.0) * inside;
    }
    passed += series * charge;
    if (after == 0.0 || after == 1.0)
        passed += fmax(charge - inside, 0.0) / g; /* the state stands at its wall, and the current goes on */
    duration = passed / voltage;
    return METERING_DELAY * duration * voltage * g / (1.0 + series * g) / tile_event_charge[t];
}
#endif

#if !DRIVES_LINES
/* One pulse on a selected cell: `size` events in the direction of `sign`, `strength` the voltage in pulses, `width` the
 * phase's share of the pulse. */
static void write_pulse(Controller *m, int k, double sign, double strength, double size, double width)
{
#if INTEGRATES
    if (tile_is_integrated(cell_tile[k])) {
        integrate_pulse(m, k, sign, strength, size, width);
        read_cell(m, k);
        return;
    }
#else
    (void)width;
#endif
#if METERS_LATE
    const double before = m->s[k], g_before = m->g[k];
    count_events(m, k, sign * size);
    count_events(m, k, sign * late_events(m, k, before, g_before, strength, size));
#elif DRIVE == CHARGE
    (void)strength;
    count_events(m, k, sign * size);
#elif DRIVE == VOLTAGE
    const int t = cell_tile[k];
    const double applied = size * strength * tile_event_flux[t];
    if (cell_series[k] == 0.0)
        count_events(m, k, sign * size * strength);
    else
        place_at(m, k, state_behind(t, m->s[k], cell_series[k], sign * applied));
#else
    /* The driver applies the flux from the state that it believes in to the next; the cell takes that flux. */
    const int t = cell_tile[k];
    const int knows = m->belief_origin[k] == m->origin[k] && m->belief_count[k] == m->count[k] && size == 1.0;
    const double series = cell_series[k], taken = event_state(t, &m->belief_origin[k], &m->belief_count[k]);
    double wanted, applied;
    (void)strength;
    m->belief_count[k] += sign;
    wanted = event_state(t, &m->belief_origin[k], &m->belief_count[k]);
    applied = fabs(flux(t, wanted) - flux(t, taken)) + series * tile_charge[t] * fabs(wanted - taken);
    if (knows) {
        m->s[k] = wanted;
        m->origin[k] = m->belief_origin[k];
        m->count[k] = m->belief_count[k];
    } else {
        place_at(m, k, state_behind(t, m->s[k], series, sign * size * applied));
    }
#endif
    read_cell(m, k);
}

#endif

/* What a pulse below the threshold does. */
static void half_select(Controller *m, int k, double sign)
{
    if (HALF_SELECT > 0.0 && cell_is_live[k]) {
        count_events(m, k, sign * HALF_SELECT);
        read_cell(m, k);
    }
}
