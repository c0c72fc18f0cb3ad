/* The closed-loop trial of one network, hand-written: the peer of ohmloom's compiled trial in benchmarks/trial.py.
 *
 * Spike-driven, with spikes as bits of one word; the static task of the paper's arena. Build without contraction of
 * multiply and add, so that it can be compared with ohmloom spike for spike. */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { INPUTS = 6, OUTPUTS = 2, MOST = 62, STEPS = 21, KINDS = 3, LEVELS = 2048 };

typedef struct {
    int64_t neurons;
    uint64_t direct[MOST], descending[MOST], plastic[MOST];
    double sign[MOST];
    int8_t kind[MOST][MOST];
    double first_weight[MOST][MOST];
    int16_t first_level[MOST][MOST];
    double table[KINDS][LEVELS];
    int16_t up[KINDS][LEVELS], down[KINDS][LEVELS];
} net_t;

typedef struct {
    double y[MOST], weight[MOST][MOST];
    int16_t level[MOST][MOST];
    uint64_t wave[MOST], last;
    int64_t count[MOST];
} state_t;

typedef struct {
    double fitness, x, y, heading;
    int64_t st, bumps, executed, events, spike_hash;
} result_t;

static const double A = 0.3, B = 0.05, C_INI = 0.5, GAIN = 0.25;
static const double WALL = 1.0, BOX = 0.4, RADIUS = 0.032, AXLE = 0.052, SPEED = 0.12, TIMESTEP = 0.032;
static const double LAMP_HEIGHT = 0.133, LAMP_POWER = 15.0, SATURATION = 0.2, IR_RANGE = 0.05;
static const double PIECE = 0.01, START_LINE = -1.5, GOAL = 1.6;
static const double POINT[3][2] = {{0.015, 0.027}, {0.029, 0.007}, {0.015, -0.027}};

static int64_t stdp(const net_t *net, state_t *s, uint64_t new, uint64_t old)
{
    int64_t events = 0;
    for (int direction = 0; direction < 2; direction++) {
        uint64_t posts = direction ? old : new, senders = direction ? new : old;
        for (; posts; posts &= posts - 1) {
            int post = __builtin_ctzll(posts);
            for (uint64_t pres = net->plastic[post] & senders; pres; pres &= pres - 1) {
                int pre = __builtin_ctzll(pres), kind = net->kind[post][pre];
                int16_t level = s->level[post][pre];
                level = direction ? net->down[kind][level] : net->up[kind][level];
                s->level[post][pre] = level;
                s->weight[post][pre] = net->sign[pre] * net->table[kind][level];
                events++;
            }
        }
    }
    return events;
}

static int64_t timestep(const net_t *net, state_t *s, const double *sensors, int64_t *hash)
{
    const int n = (int)net->neurons, first_output = n - OUTPUTS;
    int64_t events = 0;
    memset(s->count, 0, sizeof s->count);
    for (int step = 0; step < STEPS; step++) {
        uint64_t spikes = 0;
        for (int j = 0; j < n; j++) {
            double current;
            if (j < INPUTS) {
                current = sensors[j];
            } else {
                double total = 0.0;
                for (uint64_t m = (net->direct[j] & s->last) | (net->descending[j] & s->wave[j]); m; m &= m - 1)
                    total += s->weight[j][__builtin_ctzll(m)];
                current = GAIN * total;
            }
            double y = s->y[j] + (current + A - B * s->y[j]);
            if (y < 0.0)
                y = 0.0;
            if (y > 1.0) {
                y = 0.0;
                spikes |= (uint64_t)1 << j;
                s->count[j]++;
            }
            s->y[j] = y;
        }
        for (int j = INPUTS; j < first_output - 1; j++)
            s->wave[j] = s->wave[j + 1] | (spikes & ((uint64_t)1 << (j + 1)));
        events += stdp(net, s, spikes, s->last & ~spikes);
        s->last = spikes;
    }
    *hash = *hash * 31 + s->count[n - 2] * 22 + s->count[n - 1];
    return events;
}

static double box_entry(double x, double y, double dx, double dy)
{
    double enter = 0.0, leave = INFINITY, start[2] = {x, y}, step[2] = {dx, dy};
    for (int k = 0; k < 2; k++) {
        if (step[k] == 0.0) {
            if (fabs(start[k]) > BOX)
                return INFINITY;
        } else {
            double t0 = (-BOX - start[k]) / step[k], t1 = (BOX - start[k]) / step[k];
            enter = fmax(enter, fmin(t0, t1));
            leave = fmin(leave, fmax(t0, t1));
        }
    }
    return enter <= leave ? enter : INFINITY;
}

static double ray(double x, double y, double dx, double dy)
{
    double d = INFINITY;
    if (dx != 0.0)
        d = fmin(d, ((dx > 0.0 ? WALL : -WALL) - x) / dx);
    if (dy != 0.0)
        d = fmin(d, ((dy > 0.0 ? WALL : -WALL) - y) / dy);
    return fmax(fmin(d, box_entry(x, y, dx, dy)), 0.0);
}

static void sense(const double *bearing, const result_t *r, double *sensors)
{
    double ch = cos(r->heading), sh = sin(r->heading), reach = fmax(fabs(r->x), fabs(r->y));
    int near = reach + RADIUS + IR_RANGE > WALL || reach - RADIUS - IR_RANGE < BOX;
    for (int k = 0; k < 3; k++) {
        double px = r->x + ch * POINT[k][0] - sh * POINT[k][1], py = r->y + sh * POINT[k][0] + ch * POINT[k][1];
        double dx = cos(r->heading + bearing[k]), dy = sin(r->heading + bearing[k]);
        sensors[k] = near ? fmax(0.0, 1.0 - ray(px, py, dx, dy) / IR_RANGE) : 0.0;
        double lx = 1.0 - px, ly = 1.0 - py, square = lx * lx + ly * ly + LAMP_HEIGHT * LAMP_HEIGHT;
        double cosine = fmax(0.0, (lx * dx + ly * dy) / sqrt(square));
        sensors[3 + k] = fmin(1.0, cosine * LAMP_POWER / (4.0 * M_PI * square) / SATURATION);
    }
}

static int touches(double x, double y)
{
    if (fmax(fabs(x), fabs(y)) > WALL - RADIUS)
        return 1;
    double dx = fmax(fabs(x) - BOX, 0.0), dy = fmax(fabs(y) - BOX, 0.0);
    return dx * dx + dy * dy < RADIUS * RADIUS;
}

static void move(result_t *r, int action)
{
    double left = SPEED * TIMESTEP, right = left;
    if (action == 1)
        left *= 0.5;
    else if (action == 2)
        right *= 0.5;
    double turn = (right - left) / AXLE, half = 0.5 * turn, chord = 0.5 * (left + right);
    if (half != 0.0)
        chord *= sin(half) / half;
    double x = r->x + chord * cos(r->heading + half), y = r->y + chord * sin(r->heading + half);
    r->st++;
    if (!touches(x, y)) {
        r->x = x;
        r->y = y;
        r->heading += turn;
        if (r->heading > M_PI)
            r->heading -= 2.0 * M_PI;
        else if (r->heading <= -M_PI)
            r->heading += 2.0 * M_PI;
        return;
    }
    double dx = cos(r->heading), dy = sin(r->heading);
    for (int k = 0; k < 10; k++) {
        x = r->x - PIECE * dx;
        y = r->y - PIECE * dy;
        if (touches(x, y))
            break;
        r->x = x;
        r->y = y;
    }
    r->st += 10;
    r->bumps++;
}

static void philox(uint64_t key, uint32_t *c)
{
    uint32_t k0 = (uint32_t)key, k1 = (uint32_t)(key >> 32);
    for (int round = 0; round < 10; round++) {
        uint64_t p0 = (uint64_t)0xD2511F53 * c[0], p1 = (uint64_t)0xCD9E8D57 * c[2];
        uint32_t next[4] = {(uint32_t)(p1 >> 32) ^ c[1] ^ k0, (uint32_t)p1, (uint32_t)(p0 >> 32) ^ c[3] ^ k1, (uint32_t)p0};
        memcpy(c, next, sizeof next);
        k0 += 0x9E3779B9;
        k1 += 0xBB67AE85;
    }
}

void run_trial(const net_t *net, uint64_t key, const double *bearing, int64_t max_timesteps, result_t *r)
{
    static state_t s;
    double sensors[6];
    uint32_t c[4] = {0, 0, 0, 0};
    memset(&s, 0, sizeof s);
    memcpy(s.weight, net->first_weight, sizeof s.weight);
    memcpy(s.level, net->first_level, sizeof s.level);
    for (int j = 0; j < net->neurons; j++)
        s.y[j] = C_INI;
    philox(key, c);
    double u = (c[0] + 0.5) * 0x1p-32, v = (c[1] + 0.5) * 0x1p-32;
    if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
    }
    double corner = RADIUS - WALL, leg = START_LINE - 2.0 * corner;
    *r = (result_t){1e-6, corner + u * leg, corner + v * leg, 0.5 * M_PI, 0, 0, 0, 0, 0};
    for (;;) {
        sense(bearing, r, sensors);
        r->events += timestep(net, &s, sensors, &r->spike_hash);
        int left = s.count[net->neurons - 2] >= 11, right = s.count[net->neurons - 1] >= 11;
        move(r, left == right ? 0 : left ? 1 : 2);
        r->executed++;
        if (r->x + r->y >= GOAL) {
            r->fitness = fmax(r->fitness, 12500.0 - (double)r->st);
            return;
        }
        r->fitness = fmax(r->fitness, fmin(10000.0, 1000.0 / (GOAL - (r->x + r->y))) - (double)r->st);
        if (r->st >= max_timesteps)
            return;
    }
}
