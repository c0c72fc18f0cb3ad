/*
 * The arena and its robot after Howard et al. (2012), Section VIII (static) and XII (dynamic). model.c, which includes
 * this, holds the constants of the world, in SI units. Random numbers are counter-based: those of a timestep follow from
 * the trial's key and the number of timesteps, whatever was drawn before.
 */
#include "random.c"

enum { KEY_LOW, KEY_HIGH, MAX_TIMESTEPS, IR_NOISE, LIGHT_NOISE, SLIP }; /* parameters, in this order */
enum { DRAW_START, DRAW_IR, DRAW_LIGHT, DRAW_SLIP };                    /* channels of the random numbers */

typedef struct {
    double x, y, heading, best;
    double sensors[6]; /* IR 0, 2, 5, then light 0, 2, 5, each in [0, 1] */
    int st, bumps, part, executed, is_done;
} Arena;

static double larger(double a, double b) { return b > a ? b : a; }
static double smaller(double a, double b) { return b < a ? b : a; }

/* Four numbers of a timestep and a channel. */
static void draw_for(const double *p, int timestep, int channel, double *numbers)
{
    draw((uint32_t)(int32_t)p[KEY_LOW], (uint32_t)(int32_t)p[KEY_HIGH], (uint32_t)timestep, (uint32_t)channel, numbers);
}

/* Narrows [enter, leave] to where x + t dx lies in [-half, half]. */
static int narrow(double x, double dx, double half, double *enter, double *leave)
{
    double t0, t1;
    if (dx == 0.0)
        return fabs(x) <= half;
    t0 = (-half - x) / dx;
    t1 = (half - x) / dx;
    *enter = larger(*enter, smaller(t0, t1));
    *leave = smaller(*leave, larger(t0, t1));
    return 1;
}

/* Where the ray (x, y) + t (dx, dy), t >= 0, enters the box; infinity if it misses. */
static double meets_box(double x, double y, double dx, double dy)
{
    double enter = 0.0, leave = INFINITY;
    if (!narrow(x, dx, world.box_half_width, &enter, &leave) || !narrow(y, dy, world.box_half_width, &enter, &leave))
        return INFINITY;
    return enter <= leave ? enter : INFINITY;
}

static double distance_to_wall(double x, double dx)
{
    return dx > 0.0 ? (world.half_width - x) / dx : dx < 0.0 ? (-world.half_width - x) / dx : INFINITY;
}

static double distance_to_surface(double x, double y, double dx, double dy)
{
    const double wall = smaller(distance_to_wall(x, dx), distance_to_wall(y, dy));
    return larger(smaller(wall, meets_box(x, y, dx, dy)), 0.0);
}

static void add_noise(const double *p, Arena *s)
{
    const double dark = world.light_dark, lit = world.light_lit;
    double ir[4], light[4];
    int k;
    draw_for(p, s->executed, DRAW_IR, ir);
    draw_for(p, s->executed, DRAW_LIGHT, light);
    for (k = 0; k < 3; k++) {
        double factor = 1.0 + p[IR_NOISE] * (2.0 * ir[k] - 1.0), reading;
        s->sensors[k] = smaller(1.0, s->sensors[k] * factor);
        factor = 1.0 + p[LIGHT_NOISE] * (2.0 * light[k] - 1.0);
        reading = (dark - (dark - lit) * s->sensors[3 + k]) * factor;
        s->sensors[3 + k] = (dark - smaller(larger(reading, lit), dark)) / (dark - lit);
    }
}

static void sense(const double *p, Arena *s)
{
    const double cos_h = cos(s->heading), sin_h = sin(s->heading), margin = world.robot_radius + world.ir_range;
    const double far = larger(fabs(s->x), fabs(s->y));
    const int is_near = far + margin > world.half_width || far - margin < world.box_half_width;
    int k;
    for (k = 0; k < 3; k++) {
        const double forward = world.sensor_points[k][0], left = world.sensor_points[k][1];
        const double px = s->x + cos_h * forward - sin_h * left, py = s->y + sin_h * forward + cos_h * left;
        const double axis = s->heading + world.sensor_bearings[k], dx = cos(axis), dy = sin(axis);
        const double lx = world.lamp_x - px, ly = world.lamp_y - py;
        const double square = lx * lx + ly * ly + world.lamp_height * world.lamp_height;
        double cosine = (lx * dx + ly * dy) / sqrt(square), lit;
        s->sensors[k] = 0.0;
        if (is_near)
            s->sensors[k] = larger(0.0, 1.0 - distance_to_surface(px, py, dx, dy) / world.ir_range);
        /* t = 1 is the lamp, so an entry before it is a shadow. */
        if (cosine > 0.0 && SHADOW && meets_box(px, py, lx, ly) < 1.0)
            cosine = 0.0;
        lit = larger(0.0, cosine) * world.lamp_power / (4.0 * PI * square) / world.light_saturation;
        s->sensors[3 + k] = smaller(1.0, lit);
    }
    if (IS_DYNAMIC)
        add_noise(p, s);
}

/* Whether the robot's disc at (x, y) would overlap a wall or the box. */
static int touches(double x, double y)
{
    const double r = world.robot_radius;
    const double dx = larger(fabs(x) - world.box_half_width, 0.0), dy = larger(fabs(y) - world.box_half_width, 0.0);
    return larger(fabs(x), fabs(y)) > world.half_width - r || dx * dx + dy * dy < r * r;
}

/* A bump: the move is undone, and the robot reverses as far as it is free. */
static void back_off(Arena *s)
{
    const double dx = cos(s->heading), dy = sin(s->heading);
    int k;
    for (k = 0; k < REVERSE_PIECES; k++) {
        const double x = s->x - world.reverse_piece * dx, y = s->y - world.reverse_piece * dy;
        if (touches(x, y))
            break;
        s->x = x;
        s->y = y;
    }
    s->st += BUMP_COST;
    s->bumps++;
}

/* Carries out an action for one timestep: 0 forward, 1 left, 2 right. */
static void move(const double *p, int action, Arena *s)
{
    double left = world.speed * world.timestep, right = left, turn, half, chord, x, y;
    if (action == 1)
        left *= 0.5;
    else if (action == 2)
        right *= 0.5;
    if (IS_DYNAMIC) {
        double u[4];
        draw_for(p, s->executed, DRAW_SLIP, u);
        if (SLIP_STALLS) {
            left = u[0] < p[SLIP] ? 0.0 : left;
            right = u[1] < p[SLIP] ? 0.0 : right;
        } else {
            left *= 1.0 + p[SLIP] * (2.0 * u[0] - 1.0);
            right *= 1.0 + p[SLIP] * (2.0 * u[1] - 1.0);
        }
    }
    turn = (right - left) / world.axle;
    half = 0.5 * turn;
    chord = 0.5 * (left + right);
    if (half != 0.0)
        chord *= sin(half) / half;
    x = s->x + chord * cos(s->heading + half);
    y = s->y + chord * sin(s->heading + half);
    s->st++;
    s->executed++;
    if (touches(x, y)) {
        back_off(s);
        return;
    }
    s->x = x;
    s->y = y;
    s->heading += turn;
    if (s->heading > PI)
        s->heading -= 2.0 * PI;
    else if (s->heading <= -PI)
        s->heading += 2.0 * PI;
}

/* Uniform in the corner x + y < start_line, facing +y. */
static void place(const double *p, Arena *s)
{
    const double corner = world.robot_radius - world.half_width, leg = world.start_line - 2.0 * corner;
    double u[4];
    draw_for(p, 0, DRAW_START, u);
    if (u[0] + u[1] > 1.0) {
        u[0] = 1.0 - u[0];
        u[1] = 1.0 - u[1];
    }
    s->x = corner + u[0] * leg;
    s->y = corner + u[1] * leg;
    s->heading = 0.5 * PI;
}

/* The reward at the end of a timestep: eq. 14, or the number of goals found in the dynamic task. */
static void judge(const double *p, Arena *s)
{
    const double sum = s->x + s->y;
    if (!IS_DYNAMIC) {
        const double fitness = sum >= world.goal ? 12500.0 - s->st
                                                 : smaller(10000.0, 1000.0 / (world.goal - sum)) - s->st;
        s->best = larger(s->best, fitness);
        if (sum >= world.goal)
            s->part = s->is_done = 1;
    } else if (s->part == 0 && sum >= world.goal) {
        s->best = 1.0;
        s->part = 1;
        if (RESTARTS_SECOND_PART)
            place(p, s);
    } else if (s->part == 1 && s->y - s->x >= world.goal) {
        s->best = 2.0;
        s->part = 2;
        s->is_done = 1;
    }
    if (s->st >= p[MAX_TIMESTEPS])
        s->is_done = 1;
}

static void arena_start(const double *p, Arena *s)
{
    memset(s, 0, sizeof *s);
    s->best = 1e-6;
    place(p, s);
    sense(p, s);
}

/* A timestep; after the end of the trial nothing moves. */
static void arena_step(const double *p, int action, Arena *s)
{
    if (s->is_done)
        return;
    move(p, action, s);
    judge(p, s);
    sense(p, s);
}

static double fitness_of(const Arena *s) { return IS_DYNAMIC ? s->part : s->best; }
