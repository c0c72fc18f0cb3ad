"""C text and descriptions of the discrete models: the controller, the arena, and both in a closed loop."""

from __future__ import annotations

import math
from dataclasses import replace

from ohmloom.devices.emit import identifier
from ohmloom.fmu._tables import array, number, variable_table
from ohmloom.fmu.description import Block, Description, Variable
from ohmloom.neurocontroller import KINDS, LATTICES, Network
from ohmloom.neurocontroller.kinds import charge_levels
from ohmloom.neurocontroller.wiring import NOT_PLASTIC, wire
from ohmloom.sim import Arena

SENSORS = ("ir_0", "ir_2", "ir_5", "light_0", "light_2", "light_5")
LARGEST = 1e300
TINY = 1e-12
NOISE = ("ir_noise", "light_noise", "slip")


def key_parts(trial_key: int) -> dict[str, int]:
    """A trial's 64-bit key as the two signed 32-bit parameters of an arena's FMU.

    >>> key_parts(2**64 - 1)
    {'trial_key_low': -1, 'trial_key_high': -1}
    """
    words = {"trial_key_low": trial_key & 0xFFFFFFFF, "trial_key_high": trial_key >> 32}
    return {name: word - (word >> 31 << 32) for name, word in words.items()}


def controller_parameters(network: Network) -> tuple[Variable, ...]:
    """The readings that are numbers; in the order of controller.c."""
    r = network.readings
    texts = {
        "a": ("constant current of each neuron", 0.0, LARGEST), "b": ("leak", 0.0, 1.0),
        "c": ("membrane potential after a spike", 0.0, LARGEST),
        "c_ini": ("membrane potential at the start", 0.0, LARGEST),
        "y_thresh": ("threshold", TINY, LARGEST),
        "synapse_gain": ("what a spike through a synapse of weight 1 adds", TINY, LARGEST),
    }  # fmt: skip
    floats = tuple(
        Variable(name=name, kind="start", unit="1", doc=doc, start=getattr(r, name), low=low, high=high)
        for name, (doc, low, high) in texts.items()
    )
    high = Variable(name="high_count", kind="start", unit="1", doc="least number of spikes that is high",
                    type="integer", start=r.high_count, low=0, high=22)  # fmt: skip
    return (*floats, high)


def sensor_variables(kind: str, doc: str, initial: tuple[str, ...] = ()) -> tuple[Variable, ...]:
    """The six sensors, as inputs of a controller or as outputs of an arena."""
    if kind == "input":
        return tuple(Variable(name=s, kind="input", unit="1", doc=doc, low=0.0, high=1.0) for s in SENSORS)
    return tuple(Variable(name=s, kind="output", unit="1", doc=doc, initial_dependencies=initial) for s in SENSORS)


def with_arrays(description: Description) -> Description:
    """The six sensors as one array; the first three are infrared, the others light."""
    doc = "sensors in [0, 1]: " + ", ".join(SENSORS)
    return replace(description, blocks=(Block(name="sensors", doc=doc, elements=SENSORS, shape=(len(SENSORS),)),))


def action_outputs(needs: tuple[str, ...]) -> tuple[Variable, ...]:
    """Action and spike counts of the last timestep."""
    texts = {
        "action": "of the last timestep: 0 forward, 1 left, 2 right; 0 at the start",
        "spikes_left": "of the left output neuron in the last timestep, 0 to 21",
        "spikes_right": "of the right output neuron in the last timestep, 0 to 21",
    }
    return tuple(
        Variable(name=name, kind="output", unit="1", doc=doc, type="integer", dependencies=needs)
        for name, doc in texts.items()
    )


def controller_description(network: Network, timestep: float) -> Description:
    """Variables of a controller's FMU; a timestep's action depends on the sensors of that timestep."""
    return Description(
        name=network.name, identifier=identifier(network.name),
        doc=f"Spiking controller {network.name}, {network.system}, {network.neurons} neurons",
        stop_time=1000 * timestep, step_size=timestep, timestep=timestep, has_derivatives=False,
        variables=(*controller_parameters(network), *sensor_variables("input", "in [0, 1], held over a timestep"),
                   *action_outputs(SENSORS)),
    )  # fmt: skip


def arena_parameters(arena: Arena, trial_key: int) -> tuple[Variable, ...]:
    """In the order of arena.c; noise and slip are those of the dynamic task alone."""
    keys = tuple(
        Variable(name=name, kind="start", unit="1", doc="32 bits of the key of the trial's random numbers",
                 type="integer", start=word, low=-(2**31), high=2**31 - 1)
        for name, word in key_parts(trial_key).items()
    )  # fmt: skip
    longest = Variable(name="max_timesteps", kind="start", unit="1", doc="a trial ends when st reaches it",
                       type="integer", start=arena.max_timesteps, low=1, high=1_000_000)  # fmt: skip
    noise = (
        Variable(name=name, kind="start", unit="1", doc=f"of the dynamic task: {name.replace('_', ' ')}",
                 start=getattr(arena, name), low=0.0, high=math.nextafter(1.0, 0.0))
        for name in (NOISE if arena.task == "dynamic" else ())
    )  # fmt: skip
    return (*keys, longest, *noise)


def pose_outputs(at_start: tuple[str, ...]) -> tuple[Variable, ...]:
    """What an arena tells of the robot besides its sensors; it depends on the state alone."""
    return (
        *(Variable(name=name, kind="output", unit="m", doc="position of the robot", initial_dependencies=at_start)
          for name in "xy"),
        Variable(name="heading", kind="output", unit="rad", doc="0 along x, counter-clockwise"),
        Variable(name="fitness", kind="output", unit="1", doc="best so far, eq. 14; dynamic: goals found"),
        Variable(name="st", kind="output", unit="1", doc="counted timesteps, those of bumps included", type="integer"),
        Variable(name="bumps", kind="output", unit="1", doc="number of bumps", type="integer"),
        Variable(name="solved", kind="output", unit="1", doc="whether the goal was reached", type="boolean"),
        Variable(name="done", kind="output", unit="1", doc="whether the trial has ended; nothing moves then",
                 type="boolean"),
    )  # fmt: skip


def arena_description(arena: Arena, trial_key: int) -> Description:
    """Variables of an arena's FMU."""
    at_start = tuple(v.name for v in arena_parameters(arena, trial_key) if v.name != "max_timesteps")
    action = Variable(name="action", kind="input", unit="1", doc="0 forward, 1 left, 2 right; held over a timestep",
                      type="integer", low=0, high=2)  # fmt: skip
    return Description(
        name=f"arena_{arena.task}", identifier=f"arena_{arena.task}",
        doc=f"Arena of the {arena.task} task with a two-wheeled robot",
        stop_time=arena.max_timesteps * arena.timestep, step_size=arena.timestep, timestep=arena.timestep,
        has_derivatives=False,
        variables=(*arena_parameters(arena, trial_key), action,
                   *sensor_variables("output", "sensor in [0, 1]", at_start), *pose_outputs(at_start)),
    )  # fmt: skip


def system_description(name: str, parameters: tuple[Variable, ...], arena: Arena, trial_key: int) -> Description:
    """Variables of the closed loop in one FMU, of a controller with these parameters: no inputs."""
    at_start = tuple(v.name for v in arena_parameters(arena, trial_key) if v.name != "max_timesteps")
    return Description(
        name=f"{name}_{arena.task}", identifier=identifier(f"{name}_{arena.task}"),
        doc=f"Spiking controller {name} in the arena of the {arena.task} task, closed loop",
        stop_time=arena.max_timesteps * arena.timestep, step_size=arena.timestep, timestep=arena.timestep,
        has_derivatives=False,
        variables=(*arena_parameters(arena, trial_key), *parameters,
                   *sensor_variables("output", "sensor in [0, 1]", at_start), *pose_outputs(at_start),
                   *action_outputs(())),
    )  # fmt: skip


def network_table(network: Network) -> str:
    """The network as C constants: ``network.c``."""
    w = wire(network)
    posts = [post for post in range(w.neurons) for _ in range(w.starts[post], w.starts[post + 1])]
    pairs = list(zip(posts, map(int, w.senders), strict=True))
    kinds = [int(w.kind[pair]) for pair in pairs]
    charges = [
        0 if kind == NOT_PLASTIC else charge_levels(LATTICES[KINDS[kind]])[w.first_level[pair]]
        for pair, kind in zip(pairs, kinds, strict=True)
    ]
    slots = int(w.delays.max(initial=1)) + 1
    return "\n".join([
        f"/* Network {identifier(network.name)}: {network.system}, {w.neurons} neurons, {len(pairs)} synapses. */",
        f"enum {{ NEURONS = {w.neurons}, SYNAPSES = {max(len(pairs), 1)}, SLOTS = {slots}, "
        f"EMITTED = {slots if w.at_emission else 1} }};",
        f"enum {{ LAST_SPIKE = {w.last_spike}, STDP_THRESHOLD = {w.stdp_threshold}, AT_EMISSION = {w.at_emission:d}, "
        f"INPUT_BIAS = {w.input_bias:d},",
        f"       CLAMP = {w.clamp:d}, CARRY_STATE = {w.carry:d} }};",
        array("double", "sign", w.sign.tolist(), "of what a neuron's spikes add"),
        array("int", "first_synapse", w.starts.tolist(), "by receiver; the next one's is the end"),
        array("int", "receiver", posts),
        array("int", "sender", w.senders.tolist()),
        array("int", "delay", w.delays.tolist(), "in steps"),
        array("int", "synapse_kind", kinds, "0 HP, 1 PEO-PANI, 2 linear, 3 constant"),
        array("double", "first_weight", [float(w.first_weight[pair]) for pair in pairs], "with the sender's sign"),
        array("int", "first_charge", charges, "of plastic synapses, in lattice units"),
        "",
    ])  # fmt: skip


def world_table(arena: Arena) -> str:
    """The arena's constants: ``world.c``."""
    w = arena.world()
    reals = ("half_width", "box_half_width", "lamp_x", "lamp_y", "lamp_height", "lamp_power", "light_saturation",
             "light_dark", "light_lit", "ir_range", "robot_radius", "axle", "speed", "timestep", "reverse_piece",
             "start_line", "goal")  # fmt: skip
    points = ", ".join(f"{{{number(x)}, {number(y)}}}" for x, y in w.sensor_points)
    return "\n".join([
        "/* The world in SI units: positions in m, the lamp in W, angles in rad. */",
        f"enum {{ IS_DYNAMIC = {w.dynamic:d}, SHADOW = {w.shadow:d}, SLIP_STALLS = {arena.slip_mode == 'stall':d}, "
        f"BUMP_COST = {w.bump_cost},",
        f"       REVERSE_PIECES = {round(w.reverse_distance / w.reverse_piece)}, "
        f"RESTARTS_SECOND_PART = {w.restart_second_part:d} }};",
        "static const struct {",
        *(f"    double {name};" for name in reals),
        "    double sensor_points[3][2], sensor_bearings[3];",
        "} world = {",
        *(f"    .{name} = {number(getattr(w, name))}," for name in reals),
        f"    .sensor_points = {{{points}}},",
        f"    .sensor_bearings = {{{', '.join(map(number, w.sensor_bearings))}}},",
        "};",
        "",
    ])  # fmt: skip


CONTROLLER = """/* One spiking controller: sensors in; action and spike counts out. */
#include "network.c"
#include "controller.c"

enum { N_P = @n_p@, N_U = 6, N_Y = 3 };
#define TIMESTEP @timestep@

typedef Controller Memory;

@variables@

static const char *model_check(const double *p, int is_starting)
{
    (void)p, (void)is_starting;
    return NULL;
}

static void model_start(const double *p, Memory *memory) { controller_start(p, memory); }
static const char *model_step(const double *p, const double *u, Memory *memory)
{
    return controller_step(p, u, memory);
}

static void model_outputs(const double *p, const Memory *memory, double *y)
{
    (void)p;
    y[0] = memory->action;
    y[1] = memory->spiked[NEURONS - 2];
    y[2] = memory->spiked[NEURONS - 1];
}
"""
ARENA_OUTPUTS = """    memcpy(y, @arena@->sensors, sizeof @arena@->sensors);
    y[6] = @arena@->x;
    y[7] = @arena@->y;
    y[8] = @arena@->heading;
    y[9] = fitness_of(@arena@);
    y[10] = @arena@->st;
    y[11] = @arena@->bumps;
    y[12] = @arena@->part == (IS_DYNAMIC ? 2 : 1);
    y[13] = @arena@->is_done;"""
ARENA = """/* The arena: action in; sensors, pose and score out. */
#include "world.c"
#include "arena.c"

enum { N_P = @n_p@, N_U = 1, N_Y = 14 };
#define TIMESTEP @timestep@

typedef Arena Memory;

@variables@

static const char *model_check(const double *p, int is_starting)
{
    (void)p, (void)is_starting;
    return NULL;
}

static void model_start(const double *p, Memory *memory) { arena_start(p, memory); }
static const char *model_step(const double *p, const double *u, Memory *memory)
{
    arena_step(p, (int)u[0], memory);
    return NULL;
}

static void model_outputs(const double *p, const Memory *memory, double *y)
{
    (void)p;
@outputs@
}
""".replace("@outputs@", ARENA_OUTPUTS.replace("@arena@", "memory"))
SYSTEM = """/* A controller in its arena: p holds the arena's parameters, then the controller's. */
#include "world.c"
#include "arena.c"
#include "network.c"
#include "controller.c"

enum { N_P = @n_p@, N_ARENA_P = @n_arena_p@, N_U = 0, N_Y = 17 };
#define TIMESTEP @timestep@

typedef struct {
    Controller controller;
    Arena arena;
} Memory;

@variables@

static const char *model_check(const double *p, int is_starting)
{
    (void)p, (void)is_starting;
    return NULL;
}

static void model_start(const double *p, Memory *memory)
{
    memset(memory, 0, sizeof *memory);
    arena_start(p, &memory->arena);
    controller_start(p + N_ARENA_P, &memory->controller);
}

static const char *model_step(const double *p, const double *u, Memory *memory)
{
    const char *failure;
    (void)u;
    if (memory->arena.is_done)
        return NULL;
    failure = controller_step(p + N_ARENA_P, memory->arena.sensors, &memory->controller);
    if (!failure)
        arena_step(p, memory->controller.action, &memory->arena);
    return failure;
}

static void model_outputs(const double *p, const Memory *memory, double *y)
{
    const Arena *arena = &memory->arena;
    (void)p;
@outputs@
    y[14] = memory->controller.action;
    y[15] = memory->controller.spiked[NEURONS - 2];
    y[16] = memory->controller.spiked[NEURONS - 1];
}
""".replace("@outputs@", ARENA_OUTPUTS.replace("@arena@", "arena"))


def model_code(template: str, description: Description, n_arena_p: int = 0) -> str:
    """``model.c`` of one of the templates."""
    assert description.timestep is not None
    values = {"n_p": str(len(description.of("start"))), "n_arena_p": str(n_arena_p),
              "timestep": number(description.timestep), "variables": variable_table(description)}  # fmt: skip
    for name, value in values.items():
        template = template.replace(f"@{name}@", value)
    return template
