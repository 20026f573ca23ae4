/*
 * palpate.h: feel soft bodies from any program.
 *
 * A context is a Vulkan device, a scene is what a scene file says (README, "A scene"), a simulation is a scene under way on a
 * context: pose in, wrench out, a step at a time. Scenes are read from files and texts, or built by calls, or both: what a call
 * adds is checked as a file is, and names (meshes, bodies, the tool) what is there already.
 *
 * Every function gives a status. What is not PALPATE_STATUS_OK has done nothing but what its description says, and left one
 * line about what is wrong and what to do in palpate_last_error().
 *
 * Handles (palpate_context *, palpate_scene *, palpate_simulation *, palpate_loop *) are made by the functions that end in
 * _create, _create_on, _load, _parse or _start, and given back to the one that ends in _destroy, in any order: a simulation holds
 * on to its context. A handle that was destroyed is found out (PALPATE_STATUS_HANDLE), and so is null (PALPATE_STATUS_NULL). Where a handle was to be made and
 * was not, it is set to null, unless the arguments before it were wrong.
 *
 * Arrays and structs are the caller's. The library copies what it is given, writes no further than `capacity` elements or
 * `size` bytes, and keeps no pointer after a call, but for callbacks and their `user`, which must stay as long as what they were
 * given to: a log and a queue's lock until the context and the last of its simulations are gone. Structs that begin with `size`
 * may grow: set it to sizeof the struct, and the rest to zero. A size that cuts a field in two is refused
 * (PALPATE_STATUS_ARGUMENT). Strings are UTF-8 and end in a zero.
 *
 * Threads: any thread may use any handle, one at a time; a call on a handle that another is using gives PALPATE_STATUS_BUSY at
 * once. Simulations of different contexts run at the same time; those of one context take turns on its queue. The message of
 * palpate_last_error() is the thread's own. A simulation that is stepped by palpate_step_submit or held by a loop is in use
 * until that has ended; what may be asked meanwhile says so.
 *
 * Units: m, kg, s, N, Pa. y is up. Quaternions are x y z w. All numbers of a pose must be finite.
 */

#ifndef PALPATE_H
#define PALPATE_H

/* Made by cbindgen from crates/capi; do not edit. */

#include <stddef.h>
#include <stdint.h>

// Number of the binary interface: raised when something that a program was compiled against changes its meaning or goes.
// Compare it with `palpate_abi()`.
#define PALPATE_ABI 1

// It does not move. The kinds of motion: of a core, or of a rigid body.
#define PALPATE_MOTION_FIXED 0

// It follows `keys`.
#define PALPATE_MOTION_DRIVEN 1

// Forces move it.
#define PALPATE_MOTION_DYNAMIC 2

// Linear in the strain that a tetrahedron has beside its rotation. The laws of a material.
#define PALPATE_LAW_COROTATIONAL 0

// Stable neo-Hookean.
#define PALPATE_LAW_NEO_HOOKEAN 1

// A volumetric strain to each tetrahedron. Over what a soft body's volumetric strain is one number.
#define PALPATE_DILATATION_ELEMENT 0

// One to each patch of neighbouring tetrahedra: for materials that keep their volume (Poisson's ratio near one half).
#define PALPATE_DILATATION_PATCH 1

// shaderInt64 and shaderBufferInt64Atomics are enabled on the host's device.
#define PALPATE_VULKAN_INT64_ATOMICS 1

// fragmentStoresAndAtomics is enabled: the depth stage may then use the rasterizer.
#define PALPATE_VULKAN_FRAGMENT_STORES 2

// VK_KHR_external_memory_fd is enabled: skins can then be exported.
#define PALPATE_VULKAN_EXTERNAL_MEMORY_FD 4

// What was chosen, and what was found in files and mended.
#define PALPATE_LOG_NOTE 0

// The validation layer's warnings.
#define PALPATE_LOG_WARNING 1

// The validation layer's errors.
#define PALPATE_LOG_ERROR 2

// The device could not be read or written; nothing is played.
#define PALPATE_EVENT_DEVICE_LOST 1

// The device's reading was not finite, or no rotation; the last one that was right is held.
#define PALPATE_EVENT_BAD_READING 2

// The device leapt faster than a hand can move; its last pose is held until the force has faded.
#define PALPATE_EVENT_POSE_JUMP 4

// The device is beyond its workspace; the force fades.
#define PALPATE_EVENT_OUTSIDE_WORKSPACE 8

// The newest wrench is older than the watchdog allows; the force fades.
#define PALPATE_EVENT_STALE_WRENCH 16

// A wrench was not finite, and was not taken.
#define PALPATE_EVENT_BAD_WRENCH 32

// The clock stood still, ran backwards or leapt; the force starts again from zero.
#define PALPATE_EVENT_CLOCK_JUMP 64

// The tick came more than 2 ms after it was due.
#define PALPATE_EVENT_LATE_TICK 128

// The force rises from zero: at the start, and after what made it fade.
#define PALPATE_EVENT_ENGAGING 256

// The tool left the neighbourhood in which the local model is trusted; the force does not grow further.
#define PALPATE_EVENT_BEYOND_TRUST 512

// Passivity control damped.
#define PALPATE_EVENT_DAMPED 1024

// Passivity control wanted more damping than the device allows.
#define PALPATE_EVENT_DAMPING_LIMITED 2048

// The force or the torque was larger than the limit, and was shortened to it.
#define PALPATE_EVENT_CLAMPED 4096

// The force or the torque changed faster than the limit, and was held back.
#define PALPATE_EVENT_SLEW_LIMITED 8192

// What was to be played was not finite; nothing was.
#define PALPATE_EVENT_BAD_FORCE 16384

// Ticks before this one were not heard of: the simulation's step took longer than there was room for.
#define PALPATE_EVENT_RECORD_LOST 32768

// The newest wrench is followed more slowly: it holds more energy than the hand has given.
#define PALPATE_EVENT_UNPAID 65536

// Which array is exported: where skin vertices are.
#define PALPATE_SKIN_POSITIONS 0

// Which array is exported: their normals.
#define PALPATE_SKIN_NORMALS 1

// The solver stopped at its iteration limit with a residual above what single precision allows.
#define PALPATE_FLAG_NOT_CONVERGED 1

// More regions than there is room for.
#define PALPATE_FLAG_REGION_OVERFLOW 2

// More contacts than there is room for.
#define PALPATE_FLAG_CONTACT_OVERFLOW 4

// A contact deeper than the scene's `depth_limit`.
#define PALPATE_FLAG_DEPTH_BEYOND_LIMIT 8

// A skin folds over itself along the region's normal.
#define PALPATE_FLAG_NOT_A_HEIGHT_FIELD 16

// A number was not finite, and the step was recovered.
#define PALPATE_FLAG_NON_FINITE 32

// The step was repeated with a smaller time step.
#define PALPATE_FLAG_STEP_RETRIED 64

// The state was held because no step succeeded.
#define PALPATE_FLAG_FROZEN 128

// Contacts that pulled were dropped, and others pull after the repeated solve.
#define PALPATE_FLAG_ADHESIVE_DROPPED_TWICE 256

// Something turned so far within the step that it may gain energy.
#define PALPATE_FLAG_TURNS_TOO_FAR 512

// A tetrahedron was inside out, or pressed so thin that its rotation was not found.
#define PALPATE_FLAG_INVERTED 1024

// What became of a call. Whatever it is but PALPATE_STATUS_OK, nothing was changed but what the function says, and
// `palpate_last_error` has one line that says what is wrong and what to do.
enum palpate_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Done.
    PALPATE_STATUS_OK = 0,
    // A pointer or handle that must not be null is null.
    PALPATE_STATUS_NULL = 1,
    // A handle that was destroyed, is of another kind, or never was.
    PALPATE_STATUS_HANDLE = 2,
    // A value that cannot be: not finite, out of range, a struct of unknown size.
    PALPATE_STATUS_ARGUMENT = 3,
    // The caller's array is too small; how many elements there are was told.
    PALPATE_STATUS_TOO_SMALL = 4,
    // The handle is in use by another thread, or by the callback that makes this call.
    PALPATE_STATUS_BUSY = 5,
    // A scene or a file that it names is wrong.
    PALPATE_STATUS_INPUT = 6,
    // A file could not be written.
    PALPATE_STATUS_OUTPUT = 7,
    // No Vulkan device can be used, or not the haptic one.
    PALPATE_STATUS_NO_DEVICE = 8,
    // The device's memory does not suffice.
    PALPATE_STATUS_MEMORY = 9,
    // A Vulkan call failed.
    PALPATE_STATUS_VULKAN = 10,
    // The simulation cannot go on.
    PALPATE_STATUS_SIMULATION = 11,
    // A fault of the library's own. What it was at may only be destroyed.
    PALPATE_STATUS_FAULT = 12,
    // The caller's callback ended it.
    PALPATE_STATUS_CANCELLED = 13,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum palpate_status palpate_status;
#else
typedef int32_t palpate_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// What sort of device it is.
enum palpate_device_kind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Anything else.
    PALPATE_DEVICE_KIND_OTHER = 0,
    // A GPU with memory of its own.
    PALPATE_DEVICE_KIND_DISCRETE = 1,
    // A GPU that shares the processor's memory.
    PALPATE_DEVICE_KIND_INTEGRATED = 2,
    // A GPU seen through a virtual machine.
    PALPATE_DEVICE_KIND_VIRTUAL = 3,
    // A software rasterizer on the processor.
    PALPATE_DEVICE_KIND_CPU = 4,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum palpate_device_kind palpate_device_kind;
#else
typedef int32_t palpate_device_kind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// A Vulkan device under the library's hands. Simulations hold on to theirs: it goes with the last of them, whether it was
// destroyed before or not.
typedef struct palpate_context palpate_context;

// A haptic loop: a device held a thousand times a second, and a simulation that steps for it.
typedef struct palpate_loop palpate_loop;

// What a simulation is made of, any number of times: read from a file or a text, or built by calls. Files that it names
// (surfaces, layers) are opened when its bodies are prepared.
typedef struct palpate_scene palpate_scene;

// A scene under way.
typedef struct palpate_simulation palpate_simulation;

// What holds for a whole scene; its `[step]`, `[solver]` and `[contact]`. Zero is the usual value for all of it but the size.
typedef struct palpate_settings {
    // sizeof(palpate_settings).
    uint32_t size;
    // Newton iterations a step; 0: 1.
    uint32_t newton;
    // Time step, s; 0: 0.001.
    double dt;
    // Acceleration of gravity, m/s^2; zero: 0, -9.81, 0.
    double gravity[3];
    // 1: there is no gravity, and `gravity` is zero.
    uint32_t weightless;
    // Of the solver, at most; 0: 200.
    uint32_t max_iterations;
    // Relative residual at which the solver stops; 0: 1e-5.
    double tolerance;
    // Penalty stiffness per projected area, N/m^3; 0: chosen.
    double contact_stiffness;
    // Penalty damping per projected area, N s/m^3; 0: chosen.
    double contact_damping;
    // Coulomb's coefficient.
    double friction;
    // Speed below which friction is viscous, m/s; 0: 0.001.
    double friction_speed;
    // Depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m; 0: 0.02.
    double depth_limit;
} palpate_settings;

// A position and an orientation, world.
typedef struct palpate_pose {
    // m.
    double position[3];
    // Unit quaternion: x, y, z, w.
    double orientation[4];
} palpate_pose;

// A pose at a time.
typedef struct palpate_key {
    // s; each after the one before.
    double time;
    // World; an orientation of four zeros turns nothing.
    struct palpate_pose pose;
} palpate_key;

// A rigid core of a soft body: nodes that move as one. Exactly one of `inset`, the box, the sphere, `nodes` and `all` says
// which; places are in the coordinates of the mesh, before scale and pose.
typedef struct palpate_core {
    // sizeof(palpate_core).
    uint32_t size;
    // PALPATE_MOTION_*.
    uint32_t motion;
    // Its name, unlike other cores' of the body.
    const char *name;
    // Of a driven core: where the centre of the mass that it carries is, `key_count` of them. Null for others.
    const struct palpate_key *keys;
    // How many keys there are.
    size_t key_count;
    // Of a dynamic core, kg; 0: that of what it holds.
    double mass;
    // Nodes at least this deep below the skin, m, above 0.
    double inset;
    // Nodes in a box: its least corner.
    double box_low[3];
    // Its greatest corner.
    double box_high[3];
    // Nodes in a sphere: its centre.
    double sphere_centre[3];
    // Its radius, m.
    double sphere_radius;
    // These nodes, by their places in the layer's array, `node_count` of them.
    const uint32_t *nodes;
    // How many nodes there are.
    size_t node_count;
    // 1: every node.
    uint32_t all;
    // 0.
    uint32_t reserved;
} palpate_core;

// A body, of one of three kinds. Soft: it has a layer (a mesh, cells that fill the surface, or a box) and a material; without
// a surface the layer's boundary is its skin. Rigid: it has a surface and no layer. A plane: it has `plane` and nothing else
// but a name. What is zero or null is as where a scene file leaves the key out.
typedef struct palpate_body {
    // sizeof(palpate_body).
    uint32_t size;
    // Of a rigid body: PALPATE_MOTION_*.
    uint32_t motion;
    // Its name: letters, digits, '_', '-' and '.'; unlike other bodies', and not "tool".
    const char *name;
    // Its skin: the name of a surface that `palpate_scene_add_surface` took.
    const char *surface;
    // Its layer: the name of one that `palpate_scene_add_layer` took.
    const char *layer;
    // Or cells that fill the surface: their edge, m, in the surface's coordinates.
    double cell;
    // Or so many cells along the surface's largest extent.
    uint32_t across;
    // Of cells: how much larger they may be deep inside; 0, 1, 2, 4 or 8.
    uint32_t grade;
    // Of cells: depth of the shell that is filled, m; 0: all of it.
    double thickness;
    // Or a box: its least corner.
    double box_low[3];
    // Its greatest corner.
    double box_high[3];
    // Its cells along each axis.
    uint32_t box_cells[3];
    // Of a soft body: PALPATE_LAW_*.
    uint32_t law;
    // Of a soft body: PALPATE_DILATATION_*.
    uint32_t dilatation;
    // 1: a surface that would need repair is refused.
    uint32_t strict;
    // Young's modulus, Pa. This and the next four: the material of a soft body.
    double young;
    // Poisson's ratio, from -0.5 to below 0.5.
    double poisson;
    // kg/m^3.
    double density;
    // Rayleigh damping by mass, 1/s.
    double damping_mass;
    // Rayleigh damping by stiffness, s.
    double damping_stiffness;
    // A fixed half-space: outward normal n and offset d; it is where n . x <= d.
    double plane[4];
    // Of the mesh's coordinates; 0: 1.
    double scale;
    // Where the mesh's origin is, world, m.
    double position[3];
    // World orientation, unit quaternion x, y, z, w; four zeros turn nothing.
    double orientation[4];
    // At the start, world, m/s.
    double velocity[3];
    // Of a dynamic rigid body, kg.
    double mass;
    // Of a driven rigid body: where the centre of its volume is, `key_count` of them. Null for others.
    const struct palpate_key *keys;
    // How many keys there are.
    size_t key_count;
    // Of a soft body: `core_count` of them, all of the size that the first says.
    const struct palpate_core *cores;
    // How many cores there are.
    size_t core_count;
    // Convex hulls that stand for it where bodies are far apart, at most; 0: the usual number.
    uint32_t hulls;
    // 0.
    uint32_t reserved;
} palpate_body;

// What the device holds: exactly one of a sphere, a surface and a body of the scene; and the spring that holds it. Without
// one (all of it zero) the tool moves freely.
typedef struct palpate_tool {
    // sizeof(palpate_tool).
    uint32_t size;
    // 1: a surface that would need repair is refused.
    uint32_t strict;
    // Radius of a sphere, m.
    double sphere;
    // The name of a surface that `palpate_scene_add_surface` took.
    const char *surface;
    // The name of a body of the scene, held by its first core, which is dynamic. It has its own mass and pose.
    const char *body;
    // kg.
    double mass;
    // Where its centre is at the start, world, m.
    double position[3];
    // World orientation at the start; four zeros turn nothing.
    double orientation[4];
    // At the start, world, m/s.
    double velocity[3];
    // Of the surface's coordinates; 0: 1.
    double scale;
    // Of the spring between device and tool, N/m.
    double stiffness;
    // N s/m.
    double damping;
    // N m/rad.
    double angular_stiffness;
    // N m s/rad.
    double angular_damping;
} palpate_tool;

// Is told what is being prepared: the body's name, or "tool"; the stage ("cache", "read", "repair", "layer", "embed",
// "proxies", "bind"); how many bodies are ready, and how many there are, the tool counted as one. The strings live until it
// returns. Give 0 to go on, anything else to end it there. Calls on the scene give PALPATE_STATUS_BUSY meanwhile. It must
// return: no longjmp, and no exception.
typedef int32_t (*palpate_progress)(void *user, const char *body, const char *stage, uint32_t done, uint32_t total);

// An elastic material, without its law, which stays as it was made.
typedef struct palpate_material {
    // sizeof(palpate_material).
    uint32_t size;
    // 0.
    uint32_t reserved;
    // Young's modulus, Pa.
    double young;
    // Poisson's ratio, from -0.5 to below 0.5.
    double poisson;
    // kg/m^3.
    double density;
    // Rayleigh damping by mass, 1/s.
    double damping_mass;
    // Rayleigh damping by stiffness, s.
    double damping_stiffness;
} palpate_material;

// What holds touching bodies apart.
typedef struct palpate_contact_law {
    // sizeof(palpate_contact_law).
    uint32_t size;
    // 0.
    uint32_t reserved;
    // Penalty stiffness per projected area, N/m^3; below zero: from the bodies' materials.
    double stiffness;
    // Penalty damping per projected area, N s/m^3; below zero: from the stiffness.
    double damping;
    // Coulomb's coefficient.
    double friction;
    // Speed below which friction is viscous, m/s.
    double friction_speed;
    // Depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m.
    double depth_limit;
} palpate_contact_law;

// What joins device and tool.
typedef struct palpate_coupling {
    // sizeof(palpate_coupling).
    uint32_t size;
    // 0.
    uint32_t reserved;
    // N/m.
    double stiffness;
    // N s/m.
    double damping;
    // N m/rad.
    double angular_stiffness;
    // N m s/rad.
    double angular_damping;
} palpate_coupling;

// A Vulkan device of this machine. Strings that are longer than their room are cut, and end in a zero.
typedef struct palpate_device {
    // What it is.
    palpate_device_kind kind;
    // 1: it can be used; 0: `reason` says why not.
    uint32_t usable;
    // The driver's name for it. This, or a part of it, or the position in the list opens it.
    char name[256];
    // Name and version of the driver.
    char driver[256];
    // Why it cannot be used; "" where it can.
    char reason[256];
} palpate_device;

// Hears messages: PALPATE_LOG_*, and one line that lives until it returns. It is called on whatever thread a message comes up,
// within a call of this library or of the driver's; it must not call the library, and must return: no longjmp, no exception.
typedef void (*palpate_log)(void *user, uint32_t level, const char *message);

// How a context is opened. Zero is right for all of it but the size.
typedef struct palpate_context_options {
    // sizeof(palpate_context_options).
    uint32_t size;
    // 1: the Khronos validation layer looks on, with synchronisation validation, and its messages go to `log`; slow. 0: not.
    uint32_t validation;
    // Device: its position in `palpate_devices`, or part of its name; null: the best one.
    const char *device;
    // Hears what there is to say; null: nobody.
    palpate_log log;
    // Passed to `log`.
    void *log_user;
    // Folder where prepared bodies, compiled pipelines and what was measured of devices are kept for later runs; "": the
    // user's (PALPATE_CACHE, else palpate in XDG_CACHE_HOME or ~/.cache). Null: nothing is kept.
    const char *cache;
    // 1: measures, once, which of two ways is faster on the device where the scene does not say (arrays, depth stage). 0: not.
    uint32_t measure;
    // With how many threads lavapipe works, by LP_NUM_THREADS in the environment unless that is set; -1: none but the calling
    // one. 0: the environment stays as it is. Other drivers do not ask. Anything but 0 sets the variable in
    // palpate_context_create: no other thread of the process may read or write the environment meanwhile.
    int32_t threads;
} palpate_context_options;

// What a device says of itself, world axes. The library fills it before each call of `read`, as described; a device writes
// over what it knows.
typedef struct palpate_reading {
    // As the library knows it: a device writes to no field beyond.
    uint32_t size;
    // A bit each, the first in the lowest; 1: pressed. Filled with 0.
    uint32_t buttons;
    // When it was measured, s on the loop's clock. Filled with the time of the call.
    double time;
    // Where the device is. Its position must be written; its orientation is filled with the one that turns nothing, and left
    // so by a device that senses no rotation.
    struct palpate_pose pose;
    // m/s. Filled with NaN; left so, it is taken from the positions.
    double velocity[3];
    // rad/s. Filled with NaN; left so, it is taken from the orientations.
    double angular_velocity[3];
} palpate_reading;

// What a device plays until it is told the next, world axes: within the limits of its profile, always finite.
typedef struct palpate_play {
    // As the library knows it: fields beyond are not there.
    uint32_t size;
    // 0.
    uint32_t reserved;
    // What the hand is pushed with, N.
    double force[3];
    // About the device's position, N m; zero where the profile plays none.
    double torque[3];
} palpate_play;

// A haptic device that the caller's callbacks stand for. They run on threads of the loop, never two at a time, and give 0 if
// all is well; anything else says that the device is lost for now: nothing is played, and it is asked again at the next tick,
// until it has been lost for 5 s.
// None may wait for longer than a small part of a tick, nor let an exception or a longjmp out. `palpate_loop_stop` and
// `palpate_loop_destroy` from within one only ask the loop to end.
typedef struct palpate_haptic_device {
    // sizeof(palpate_haptic_device).
    uint32_t size;
    // 0.
    uint32_t reserved;
    // Given to each callback; the library does not look at it. What it points to stays until the loop has ended.
    void *user;
    // Makes ready; called once, first of all. Null: there is nothing to do. Other than 0: the loop does not begin, and `close`
    // is not called.
    int32_t (*open)(void *user);
    // Where the device is at `time`, s on the loop's clock; called once a tick. Readings that cannot be (not finite, no
    // rotation, too fast for a hand) are not believed.
    int32_t (*read)(void *user, double time, struct palpate_reading *reading);
    // Plays from now until the next; called once a tick, and with zero after `open` and before `close`.
    int32_t (*write)(void *user, const struct palpate_play *play);
    // Lets go; called once at the end, whatever happened, if `open` gave 0. Null: there is nothing to do.
    void (*close)(void *user);
    // What the device can do, by name: "scripted", "premium", "touch", "omega.x", "delta.6", "sigma.7", "falcon", "inverse3",
    // "minverse" or "mouse" (README, "The hand"). Null: the scene's `haptics.profile`.
    const char *profile;
} palpate_haptic_device;

// How a loop is run. What is 0 is as in the scene's `[haptics]`, or as that table's default where there is none.
typedef struct palpate_loop_options {
    // sizeof(palpate_loop_options).
    uint32_t size;
    // Whether contact is followed between wrenches: 1 yes, -1 no.
    int32_t local_model;
    // Whether the passivity controller acts: 1 yes, -1 no.
    int32_t passivity;
    // 0.
    uint32_t reserved;
    // Ticks a second, 50 to 4000.
    double rate;
    // How long the loop lasts, s; 0: until it is stopped.
    double seconds;
    // Greatest force, N. This and the next four can lower what the profile allows; where one would raise it, the profile's
    // holds, and a note says so.
    double max_force;
    // Greatest torque, N m.
    double max_torque;
    // Greatest change of the force, N/s.
    double max_slew;
    // Radius of the workspace about where the device was first read, m.
    double workspace;
    // Age from which a wrench makes the force fade, s.
    double watchdog;
    // The longest step of the simulation, s: the loop takes the shortest that lasts as long as it costs, from the scene's dt up
    // to this; where that is not enough, bodies move slower than in the world.
    double longest_step;
} palpate_loop_options;

// A loop as it was after the simulation's last step: what it says of ticks is no older than a step. Before the first tick
// all of it is zero but `steps`, `is_running` and poses that turn nothing.
typedef struct palpate_loop_state {
    // sizeof(palpate_loop_state).
    uint32_t size;
    // 1: it runs; 0: it has ended, and the device is closed.
    uint32_t is_running;
    // What it failed with; PALPATE_STATUS_OK where it did not, or has not yet. A device that stays lost ends
    // the loop after 5 s, and is no failure.
    palpate_status status;
    // How many notes there are for `palpate_loop_note`.
    uint32_t notes;
    // What happened in the newest tick: a bit each, PALPATE_EVENT_*.
    uint32_t events;
    // What happened in any tick so far.
    uint32_t events_so_far;
    // Buttons of the device, a bit each.
    uint32_t buttons;
    // 0.
    uint32_t reserved;
    // Ticks done.
    uint64_t ticks;
    // Steps of the simulation done, those before the first tick included.
    uint64_t steps;
    // Steps done by the wrench that the newest tick plays; 0: it has none yet.
    uint64_t wrench_step;
    // Deadlines that were missed by more than 2 ms.
    uint64_t missed;
    // When the newest tick began, s since the loop did.
    double time;
    // At the newest tick: how long ago the inputs of its wrench were taken, s.
    double wrench_age;
    // Where the device is taken to be.
    struct palpate_pose device;
    // Where the tool is, which follows it.
    struct palpate_pose tool;
    // Of contact on the tool, as the local model has it at the newest tick, N.
    double contact_force[3];
    // The same, N m.
    double contact_torque[3];
    // What the device was last told to play, N.
    double played_force[3];
    // The same, N m.
    double played_torque[3];
    // Share of the force that is played, from 0 to 1.
    double gain;
    // Greatest force that was played, N.
    double peak_force;
    // How late ticks came, s: what 99 of 100 stay within, brought up to date every 1000 ticks and at the end.
    double late_p99;
    // The latest, s.
    double late_worst;
} palpate_loop_state;

// What a step did to the tool. Of a scene without one, force, torque and positions are zero, and orientations turn nothing.
typedef struct palpate_wrench {
    // sizeof(palpate_wrench).
    uint32_t size;
    // What the step has to confess: a bit each, PALPATE_FLAG_*. 0: nothing.
    uint32_t flags;
    // Steps done.
    uint64_t step;
    // At the end of the step, s.
    double time;
    // Of contacts on the tool, world axes, N.
    double force[3];
    // The same about the tool's centre, N m.
    double torque[3];
    // Where the tool is.
    struct palpate_pose tool;
    // Where the device is, which holds it.
    struct palpate_pose device;
    // Greatest depth of a contact, m.
    double max_depth;
    // What the solver left, of the right-hand side.
    double residual;
    // Colliding vertices, of both sides.
    uint32_t contacts;
    // Of the solver.
    uint32_t iterations;
} palpate_wrench;

// A lock of the host's around its queue.
typedef void (*palpate_queue_lock)(void *user);

// A Vulkan device of the host's. Its instance was created for Vulkan 1.3, and the device with the features
// scalarBlockLayout, synchronization2, dynamicRendering and maintenance4. All of it stays alive until the context and the last
// of its simulations are gone.
typedef struct palpate_vulkan {
    // sizeof(palpate_vulkan).
    uint32_t size;
    // What else the device was created with: PALPATE_VULKAN_*, added up. Say no more than is true.
    uint32_t enabled;
    // vkGetInstanceProcAddr of the loader that the handles come from; null: the system's loader is opened.
    void (*get_instance_proc_addr)(void);
    // VkInstance.
    void *instance;
    // VkPhysicalDevice.
    void *physical_device;
    // VkDevice.
    void *device;
    // VkQueue. The library submits to it in every call that steps or copies, and waits for its own work.
    void *queue;
    // The queue's family, which has graphics and compute.
    uint32_t queue_family;
    // 0.
    uint32_t reserved;
    // Called before each use of the queue and after it, on the same thread, on any thread; the time between is short. They must
    // not call the library, and the host must not hold the lock when it does, unless it can be taken twice. Null, both: the host
    // itself sees to it that it uses the queue in none of the library's calls, and makes one context of it at most.
    palpate_queue_lock lock;
    // As `lock`.
    palpate_queue_lock unlock;
    // Passed to both.
    void *lock_user;
    // Hears what there is to say; null: nobody.
    palpate_log log;
    // Passed to `log`.
    void *log_user;
    // As in palpate_context_options.
    const char *cache;
    // As in palpate_context_options.
    uint32_t measure;
} palpate_vulkan;

// The skins on the device: arrays over the vertices of all bodies, one body's after another's, the tool's last. On a device
// of the host's the buffers can be bound at once (usage: storage, texel, transfer; positions and normals vertex as well); they
// live as long as the simulation, unless friction comes into a scene that had none: ask again then, and export again.
typedef struct palpate_skins {
    // sizeof(palpate_skins).
    uint32_t size;
    // Vertices of all skins.
    uint32_t vertex_count;
    // Triangles of all skins.
    uint32_t triangle_count;
    // 0.
    uint32_t reserved;
    // VkBuffer: four floats a vertex, x y z 1, m from the origin.
    uint64_t positions;
    // VkBuffer: four floats a vertex, unit and outward, and 0.
    uint64_t normals;
    // VkBuffer: four uint32_t a triangle, its vertices counter-clockwise from outside, and 0.
    uint64_t triangles;
} palpate_skins;

// A colliding skin vertex of the last step.
typedef struct palpate_contact {
    // Whose vertex it is, and what it touches: positions in the scene; the tool comes after the bodies.
    uint32_t body[2];
    // The vertex, of its body's skin.
    uint32_t vertex;
    // 0.
    uint32_t reserved;
    // Where the vertex is now, world, m.
    double position[3];
    // Unit, world, out of what is touched.
    double normal[3];
    // m.
    double depth;
    // Skin that it stands for, as seen along the normal, m^2.
    double area;
    // Along the normal at the end of the step, Pa: times the area, it is the contact's part of the wrench but for friction. Of
    // the start of the step after a saved state was taken up.
    double pressure;
} palpate_contact;

// What a stage of the step costs.
typedef struct palpate_stage {
    // Its name, as in the README: "pose", "cull", "skin", "depth", "contact", "elastic", "solve", "wrench" and so on; in every
    // second timed step the first five are one, "pose to contact".
    char name[32];
    // On the device in the last step, microseconds; 0 where that was not timed.
    double microseconds;
    // Dispatches, draws, fills and copies in a step like the last; 0 of "pose to contact".
    uint32_t passes;
    // 0.
    uint32_t reserved;
} palpate_stage;



#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The interface's number that the library was built with; differs from `PALPATE_ABI` where header and library do not belong
// together.
uint32_t palpate_abi(void);

// The library's version, such as "0.1.0". Never null; lives as long as the program.
const char *palpate_version(void);

// Makes a scene of nothing, for the functions below. `settings` may be null. Files that its texts name are relative to the
// working directory.
palpate_status palpate_scene_create(const struct palpate_settings *settings,
                                    struct palpate_scene **scene);

// Adds the tables of a text to a scene, as of a scene file: anything that the structs here have no fields for, such as joints,
// regions, skeletons, probes and `[haptics]`. Bodies and probes come after those that there are; other tables and keys replace
// what there is, and what the text leaves out stays. Bodies may name meshes that were handed over, `surface = { mesh = "name" }`
// and `layer = { mesh = "name" }`.
palpate_status palpate_scene_add(struct palpate_scene *scene,
                                 const char *text);

// Hands a surface over, under a name by which bodies and the tool call it: what an OBJ file of the same vertices and faces
// would be. `vertices`: 3 * `vertex_count` numbers, m before the body's scale. `triangles`: 3 * `triangle_count` vertices,
// counted from 0, counter-clockwise seen from outside. What of it needs repair is repaired where bodies are prepared. The name
// is no other surface's, and may be any text but "".
palpate_status palpate_scene_add_surface(struct palpate_scene *scene,
                                         const char *name,
                                         const double *vertices,
                                         size_t vertex_count,
                                         const uint32_t *triangles,
                                         size_t triangle_count);

// Hands the tetrahedra of a layer over, under a name by which bodies call it: what a mesh file of them would be. `nodes`:
// 3 * `node_count` numbers, m before the body's scale. `tetrahedra`: 4 * `tetrahedron_count` nodes, counted from 0; those that
// are inside out are turned, those without volume or given twice are refused. The name is no other layer's, and may be any text
// but "".
palpate_status palpate_scene_add_layer(struct palpate_scene *scene,
                                       const char *name,
                                       const double *nodes,
                                       size_t node_count,
                                       const uint32_t *tetrahedra,
                                       size_t tetrahedron_count);

// Adds a body. `index` receives its position in the scene, from 0, and may be null. What is wrong is named as in a scene file:
// `body.NAME.material.young` is the field `young`.
palpate_status palpate_scene_add_body(struct palpate_scene *scene,
                                      const struct palpate_body *body,
                                      uint32_t *index);

// Says with what a body of a scene collides: with `count` bodies of these names ("tool": the tool), all of which are there.
// `names` null: with every other, as it is where nobody says. Two bodies collide where each has the other in its list or has
// no list; a list of none is one.
palpate_status palpate_scene_set_collides(struct palpate_scene *scene,
                                          uint32_t body,
                                          const char *const *names,
                                          size_t count);

// Gives a scene this tool, held so, in place of any that it has.
palpate_status palpate_scene_set_tool(struct palpate_scene *scene, const struct palpate_tool *tool);

// Says where palpate_scene_prepare keeps prepared bodies for later runs: in `folder`, or the user's where that is "" (as the
// context's options say). Null, and without this call: nowhere.
palpate_status palpate_scene_cache(struct palpate_scene *scene,
                                   const char *folder);

// Prepares the bodies of a scene: repairs surfaces, fills them with cells, and so on: seconds, unless they were kept
// (palpate_scene_cache).
// palpate_simulation_create does it too where it is not done, with nobody watching. `progress` is called as each stage begins,
// with `user`, on this thread; it may be null. Where it ends it (PALPATE_STATUS_CANCELLED), bodies that are ready stay so, and
// the next call goes on.
palpate_status palpate_scene_prepare(struct palpate_scene *scene,
                                     palpate_progress progress,
                                     void *user);

// The material of a soft body: its own at `index` 0, then those of its regions in the order of the scene.
palpate_status palpate_material_get(struct palpate_simulation *simulation,
                                    uint32_t body,
                                    uint32_t index,
                                    struct palpate_material *material);

// Gives a soft body another material from the next step on, `index` as for `palpate_material_get`. Nothing is prepared or
// recorded again; whether the solver has a coarse level for the body stays as it was chosen. PALPATE_STATUS_ARGUMENT: there is
// no such material, or it cannot be so; or the body has several and the density would move its centre of mass.
palpate_status palpate_material_set(struct palpate_simulation *simulation,
                                    uint32_t body,
                                    uint32_t index,
                                    const struct palpate_material *material);

// The contact law in force; numbers that are chosen from the materials are -1.
palpate_status palpate_contact_get(struct palpate_simulation *simulation, struct palpate_contact_law *law);

// Another contact law from the next step on. Friction in a scene that had none is recorded first, which takes some time once.
palpate_status palpate_contact_set(struct palpate_simulation *simulation,
                                   const struct palpate_contact_law *law);

// Another coupling between device and tool from the next step on; null: none, and the tool moves freely.
palpate_status palpate_coupling_set(struct palpate_simulation *simulation, const struct palpate_coupling *coupling);

// Where a core of a body is: the pose of the origin of the body's file, carried along. Cores are counted from 0, bones first;
// a rigid body has one.
palpate_status palpate_core_pose(struct palpate_simulation *simulation,
                                 uint32_t body,
                                 uint32_t core,
                                 struct palpate_pose *pose);

// Takes a driven core from where it is to a pose (as `palpate_core_pose` tells it), evenly, within `seconds` of simulated time
// but a step at least, and leaves it there; keys that it had are forgotten. Call it before every step to animate it. A core
// that is not driven gives PALPATE_STATUS_ARGUMENT.
palpate_status palpate_core_move(struct palpate_simulation *simulation,
                                 uint32_t body,
                                 uint32_t core,
                                 const struct palpate_pose *pose,
                                 double seconds);

// Lists the devices of this machine, usable or not. `count` receives how many there are; up to `capacity` are written to
// `devices`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more, and none was written.
palpate_status palpate_devices(struct palpate_device *devices,
                               size_t capacity,
                               size_t *count);

// Opens a device. `options` may be null.
palpate_status palpate_context_create(const struct palpate_context_options *options, struct palpate_context **context);

// Lets go of a context. Null does nothing.
palpate_status palpate_context_destroy(struct palpate_context *context);

// Bytes of the device's memory that arrays of a context's simulations hold.
palpate_status palpate_context_memory(struct palpate_context *context, uint64_t *bytes);

// Begins a loop: `device` is read and told what to play at the loop's rate, while the simulation, which must have a tool, steps
// in the world's time from where the device is. Both happen on threads of the loop's. `device` and `options` are copied;
// `options` may be null: all as in the scene's `[haptics]`. Waits for five first steps, which tell how long one takes, and for
// the device to open; PALPATE_STATUS_NO_DEVICE where it did not. `the_loop` is set before the first callback is called, and to
// null where there is no loop.
//
// The loop has the simulation until it has ended: calls on it give PALPATE_STATUS_BUSY, but `palpate_wrench_newest`,
// `palpate_step_poll` and `palpate_step_wait`. It may be destroyed meanwhile. Afterwards it steps on from where the loop left
// it, tool, device and time. A loop that is not stopped goes on; stop it before the program ends.
palpate_status palpate_loop_start(struct palpate_simulation *simulation,
                                  const struct palpate_haptic_device *device,
                                  const struct palpate_loop_options *options,
                                  struct palpate_loop **the_loop);

// What a loop does and has done. Never waits; any thread may ask at any time, callbacks too.
palpate_status palpate_loop_read(struct palpate_loop *the_loop, struct palpate_loop_state *state);

// The wrench of the newest step of a loop's simulation, with what that has to confess, as `palpate_wrench_newest` tells it; also
// after the simulation's handle was destroyed. `age_seconds` receives how long ago the step began, s; it may be null.
palpate_status palpate_loop_wrench(struct palpate_loop *the_loop,
                                   struct palpate_wrench *wrench,
                                   double *age_seconds);

// Something to know about a loop, in one line: what its coupling is and why, which limits were asked for that the profile does
// not allow, whether it lacks priority. `note`: from 0; how many there are is in `palpate_loop_state`. `count` receives the
// length of the text in bytes, with its ending zero; up to `capacity` bytes are written to `text`, which may be null where
// `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more, and none was written.
palpate_status palpate_loop_note(struct palpate_loop *the_loop,
                                 uint32_t note,
                                 char *text,
                                 size_t capacity,
                                 size_t *count);

// Why a loop ended, in one line; "" while it runs. The text comes as from `palpate_loop_note`.
palpate_status palpate_loop_ended(struct palpate_loop *the_loop, char *text, size_t capacity, size_t *count);

// Ends a loop: the device plays nothing and is closed, and the simulation can be used again when this returns. What the loop
// tells can still be read. Gives what the loop failed with, if it did. From within a callback the loop is only asked to end,
// and the call gives PALPATE_STATUS_BUSY.
palpate_status palpate_loop_stop(struct palpate_loop *the_loop);

// Stops a loop as `palpate_loop_stop` does, and lets go of it. From within a callback the loop is only asked to end, and its
// handle stays. Null does nothing.
palpate_status palpate_loop_destroy(struct palpate_loop *the_loop);

// Makes a context on a device of the host's, which is left open when the context goes. What is in reach is checked: that the
// physical device is of the instance and can run palpate, and that the queue's family has graphics and compute; handles that are
// none, and features that were not enabled, cannot be found out.
palpate_status palpate_context_create_on(const struct palpate_vulkan *vulkan,
                                         struct palpate_context **context);

// Reads a scene file.
palpate_status palpate_scene_load(const char *file, struct palpate_scene **scene);

// Reads a scene from the text of a scene file. `folder`: what files that it names are relative to; null: the working
// directory.
palpate_status palpate_scene_parse(const char *text, const char *folder, struct palpate_scene **scene);

// Lets go of a scene. Null does nothing.
palpate_status palpate_scene_destroy(struct palpate_scene *scene);

// Where the skin of a body is, whatever its kind; the tool comes after the bodies. `origin`: three numbers that positions are
// relative to, m; null: the world's. `positions` and `normals` have room for `capacity` vertices, three floats each (m; unit and
// outward); either may be null. `count` receives how many there are. PALPATE_STATUS_TOO_SMALL: none was written.
palpate_status palpate_skin(struct palpate_simulation *simulation,
                            uint32_t body,
                            const double *origin,
                            float (*positions)[3],
                            float (*normals)[3],
                            size_t capacity,
                            size_t *count);

// The triangles of a body's skin: three of its vertices each, counter-clockwise from outside; they do not change. `count`
// receives how many there are; `triangles` has room for `capacity` and may be null where that is 0. PALPATE_STATUS_TOO_SMALL:
// none was written.
palpate_status palpate_skin_triangles(struct palpate_simulation *simulation,
                                      uint32_t body,
                                      uint32_t (*triangles)[3],
                                      size_t capacity,
                                      size_t *count);

// Brings the skins on the device up to date, relative to `origin` (three numbers, m; null: the world's), and tells where they
// are: nothing is copied. The arrays are filled when this returns, and stay until the next call or `palpate_skin`; work of the
// host's that reads them must be submitted to the same queue, or be done before that. No other call writes to them.
// The first call makes the arrays.
palpate_status palpate_skin_buffers(struct palpate_simulation *simulation,
                                    const double *origin,
                                    struct palpate_skins *skins);

// The vertices of a body among those of `palpate_skin_buffers`: the first, and how many. The tool comes after the bodies.
palpate_status palpate_skin_range(struct palpate_simulation *simulation,
                                  uint32_t body,
                                  uint32_t *first,
                                  uint32_t *count);

// A file descriptor of the memory of one of the arrays of `palpate_skin_buffers` (PALPATE_SKIN_*), for another API to import
// (VK_KHR_external_memory_fd, opaque; a dedicated allocation that begins with the array), and the size of that memory in
// bytes. The descriptor is the caller's: what imports it owns it, else close it. Call `palpate_skin_buffers` to bring the
// array up to date. PALPATE_STATUS_VULKAN: the device cannot.
palpate_status palpate_skin_export(struct palpate_simulation *simulation,
                                   uint32_t which,
                                   int32_t *descriptor,
                                   uint64_t *bytes);

// The contacts of the last step, as many as its wrench says. `count` receives how many there are; `contacts` has room for `capacity` and may be null where
// that is 0. PALPATE_STATUS_TOO_SMALL: none was written.
palpate_status palpate_contacts(struct palpate_simulation *simulation,
                                struct palpate_contact *contacts,
                                size_t capacity,
                                size_t *count);

// Makes a simulation of a scene on a context: prepares the bodies where palpate_scene_prepare has not, and records the step.
// The scene may be destroyed afterwards.
palpate_status palpate_simulation_create(struct palpate_context *context,
                                         struct palpate_scene *scene,
                                         struct palpate_simulation **simulation);

// Lets go of a simulation; waits for a step that was submitted and is under way. One that a loop holds goes when the loop
// ends. Null does nothing.
palpate_status palpate_simulation_destroy(struct palpate_simulation *simulation);

// One step of the scene's `dt`: pose in, wrench out, when it is done. `device`: where the device is at the end of the step,
// having moved evenly from where it was at the last; null: where the scene's `[drive]` has it, or once a pose was given, where
// that left it. `wrench` may be null. A step that fails in Vulkan or the solver ends the simulation: it may be read and
// destroyed, and gives PALPATE_STATUS_SIMULATION for further steps.
palpate_status palpate_step(struct palpate_simulation *simulation,
                            const struct palpate_pose *device,
                            struct palpate_wrench *wrench);

// Where the nodes of a soft body are, world, m: `count` of them, three numbers each, in the order of its layer. `body` is
// its position in the scene, from 0. `count` receives how many nodes it has, 0 where it is not soft; up to `capacity` nodes
// are written to `positions`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more, and none was
// written.
palpate_status palpate_nodes(struct palpate_simulation *simulation,
                             uint32_t body,
                             double (*positions)[3],
                             size_t capacity,
                             size_t *count);

// Saves all that the next step starts from: where everything is and how it moves, and what the solver and culling remember.
// What was set is not in it (material, contact, coupling). Between two steps; costs a copy from the device.
// `size` receives how many bytes it takes, which differs by some hundreds from step to step: ask just before. They are written
// to `bytes`, which has room for `capacity` and may be null where that is 0. PALPATE_STATUS_TOO_SMALL: none was written.
palpate_status palpate_state_save(struct palpate_simulation *simulation,
                                  uint8_t *bytes,
                                  size_t capacity,
                                  size_t *size);

// Takes up a state that was saved, of this simulation or of another of the same bodies, tool and device, in this process or
// another: from there on both give the same bits, if the same was set. PALPATE_STATUS_ARGUMENT: the bytes are none that this
// version saved, are damaged, or belong to other bodies; nothing changed. A simulation whose step failed goes on from the state.
palpate_status palpate_state_restore(struct palpate_simulation *simulation,
                                     const uint8_t *bytes,
                                     size_t size);

// Times every so many steps from now on; 0, as at the beginning: none. A timed step is up to a millisecond slower on some
// drivers.
palpate_status palpate_time_every(struct palpate_simulation *simulation,
                                  uint64_t steps);

// The stages of the step, in their order, and what each costs. `count` receives how many there are; `stages` has room for
// `capacity` and may be null where that is 0. PALPATE_STATUS_TOO_SMALL: none was written.
palpate_status palpate_stages(struct palpate_simulation *simulation,
                              struct palpate_stage *stages,
                              size_t capacity,
                              size_t *count);

// What went wrong in the last call on this thread that did not give PALPATE_STATUS_OK, in one line; "" where none did. Never
// null; lives until the next such call on this thread.
const char *palpate_last_error(void);

// Begins a step, and does not wait for it: a thread of the simulation's, which begins with the first of these calls, does it.
// `device`: as for `palpate_step`; may be null, and is not needed after the call. Until the step is done, what reads or
// changes the simulation gives PALPATE_STATUS_BUSY, this call too; `palpate_step_poll`, `palpate_step_wait` and
// `palpate_wrench_newest` do not. The steps are those of `palpate_step`, bit for bit.
palpate_status palpate_step_submit(struct palpate_simulation *simulation,
                                   const struct palpate_pose *device);

// Whether the submitted step is done; never waits. `is_done` receives 1 where no submitted step is under way, else 0. Where a
// submitted step failed it receives 1, and the call gives what the step failed with, as `palpate_step` would have; so does
// every later one until a state is restored, for there is no step after that.
palpate_status palpate_step_poll(struct palpate_simulation *simulation,
                                 int32_t *is_done);

// Waits until no submitted step is under way. Gives what it failed with, as `palpate_step_poll` does.
palpate_status palpate_step_wait(struct palpate_simulation *simulation);

// The wrench of the newest step that is done, whether it was submitted, a `palpate_step` or a loop's; never waits, and can be
// asked by any thread at any time. `age_seconds` receives how long ago that step was given its pose (submitted, or called for,
// or begun by the loop), s; it may be null. Before the first step the wrench has `step` 0, and its age is infinite. Where a
// submitted step failed, both are still told, and the call gives what it failed with. A state that is restored has none.
palpate_status palpate_wrench_newest(struct palpate_simulation *simulation,
                                     struct palpate_wrench *wrench,
                                     double *age_seconds);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PALPATE_H */
