/*
 * palpate.h: feel soft bodies from any program.
 *
 * A context is an opened Vulkan device. A scene is what a scene file describes (docs/reference/scene.md). A simulation runs a scene on
 * a context, a step at a time: the pose of the haptic device goes in, the net wrench on the tool comes out. Scenes are read from
 * files or from text, or built by calls, or both. What a call adds is checked as strictly as a file, and may refer by name to
 * meshes, bodies and the tool that the scene has already.
 *
 * Every function returns a status. A function that does not return PALPATE_STATUS_OK has changed nothing, unless its description
 * says otherwise, and palpate_last_error() gives one line: the problem and its remedy.
 *
 * Handles (palpate_context *, palpate_scene *, palpate_simulation *, palpate_loop *) are made by the functions that end in
 * _create, _create_on, _load, _parse or _start, and released by the one that ends in _destroy, in any order: a simulation keeps
 * its context alive. Use of a destroyed handle is detected (PALPATE_STATUS_HANDLE), and so is null (PALPATE_STATUS_NULL). A
 * function that fails to make a handle sets it to null, unless an argument before it was wrong.
 *
 * Arrays and structs belong to the caller. The library copies its inputs, writes at most `capacity` elements or `size` bytes,
 * and keeps no pointer after a call. The exception are callbacks and their `user` pointer, which must stay valid as long as the
 * object they were given to: a log and a queue lock until the context and the last of its simulations are gone. Structs that
 * begin with `size` may grow in later versions: set `size` to sizeof the struct and all other fields to zero or to a value. A
 * size that cuts a field in two is refused (PALPATE_STATUS_ARGUMENT). Strings are UTF-8 and end in a zero byte.
 *
 * Threads: any thread may use any handle, but only one thread at a time; a call on a handle that another thread is using returns
 * PALPATE_STATUS_BUSY at once. Simulations of different contexts run at the same time; those of one context take turns on its
 * queue. The message of palpate_last_error() belongs to the thread. A simulation that palpate_step_submit steps, or that a
 * haptic loop uses, is busy until that has ended; functions that may be called meanwhile say so.
 *
 * Units: m, kg, s, N, Pa. y is up. Quaternions are x y z w. All numbers of a pose must be finite.
 */

#ifndef PALPATE_H
#define PALPATE_H

/* Made by cbindgen from crates/capi; do not edit. */

#include <stddef.h>
#include <stdint.h>

// Version number of the binary interface that palpate.h declares. It is raised when something that a compiled program
// relies on changes its meaning or is removed. A program should compare it with the result of `palpate_abi()`.
#define PALPATE_ABI 1

// Level of a message: a note about what the library chose, or about defects of files that it repaired.
#define PALPATE_LOG_NOTE 0

// Level of a message: a warning of the Vulkan validation layer.
#define PALPATE_LOG_WARNING 1

// Level of a message: an error of the Vulkan validation layer.
#define PALPATE_LOG_ERROR 2

// Feature of a lent device, for `enabled` of palpate_vulkan: shaderInt64 and shaderBufferInt64Atomics are enabled.
#define PALPATE_VULKAN_INT64_ATOMICS 1

// Feature of a lent device, for `enabled` of palpate_vulkan: fragmentStoresAndAtomics is enabled, so that the library
// may use the rasterizer to compute penetration depths.
#define PALPATE_VULKAN_FRAGMENT_STORES 2

// Feature of a lent device, for `enabled` of palpate_vulkan: VK_KHR_external_memory_fd is enabled, so that skins
// (surface meshes of bodies) can be exported.
#define PALPATE_VULKAN_EXTERNAL_MEMORY_FD 4

// Kind of motion of a rigid core or of a rigid body: fixed, that is, the core or body does not move.
#define PALPATE_MOTION_FIXED 0

// Kind of motion: driven (kinematic), that is, the core or body follows its keyframes, `keys`.
#define PALPATE_MOTION_DRIVEN 1

// Kind of motion: dynamic, that is, forces move the core or body.
#define PALPATE_MOTION_DYNAMIC 2

// Material law: corotational, that is, linear in the strain that remains when the rotation of a tetrahedron is
// removed.
#define PALPATE_LAW_COROTATIONAL 0

// Material law: stable neo-Hookean.
#define PALPATE_LAW_NEO_HOOKEAN 1

// Volumetric strain of a soft body: each tetrahedron has its own volumetric strain.
#define PALPATE_DILATATION_ELEMENT 0

// Volumetric strain of a soft body: averaged over patches of neighbouring tetrahedra (F-bar), against locking in
// nearly incompressible materials (Poisson's ratio near 0.5).
#define PALPATE_DILATATION_PATCH 1

// Flag of a step: at the end of the solve the residual is far above the solver's tolerance, and also far above what
// single precision can reach.
#define PALPATE_FLAG_NOT_CONVERGED 1

// Flag of a step: the arrays have too little room for the contact patches (places where two bodies may touch, with one
// normal each).
#define PALPATE_FLAG_REGION_OVERFLOW 2

// Flag of a step: the arrays have too little room for the contacts, or for the hits of the rays that search for them.
#define PALPATE_FLAG_CONTACT_OVERFLOW 4

// Flag of a step: a contact was deeper than the scene's `depth_limit`.
#define PALPATE_FLAG_DEPTH_BEYOND_LIMIT 8

// Flag of a step: a skin (surface mesh) folds over itself along the normal of a contact patch, so that the penetration
// depth is not unique there.
#define PALPATE_FLAG_NOT_A_HEIGHT_FIELD 16

// Flag of a step: a number was not finite, so the step was repeated (PALPATE_FLAG_STEP_RETRIED) or given up
// (PALPATE_FLAG_FROZEN).
#define PALPATE_FLAG_NON_FINITE 32

// Flag of a step: the step failed and was repeated as several shorter time steps.
#define PALPATE_FLAG_STEP_RETRIED 64

// Flag of a step: the step failed with shorter time steps too, so everything that forces move was stopped where it
// was.
#define PALPATE_FLAG_FROZEN 128

// Flag of a step: contacts under tension were released, but after the last release other contacts are under tension.
#define PALPATE_FLAG_ADHESIVE_DROPPED_TWICE 256

// Flag of a step: a body, or a rigid core in it, turned so far within the step that the body may gain energy.
#define PALPATE_FLAG_TURNS_TOO_FAR 512

// Flag of a step: a tetrahedron was inverted, or pressed so flat that its rotation was not found.
#define PALPATE_FLAG_INVERTED 1024

// Flag of a step: the Newton iterations left much of the step's nonlinear equations unsolved.
#define PALPATE_FLAG_NEWTON_NOT_CONVERGED 2048

// Flag of a step: the tool moved further than its own extent in a step near a body, which it may have passed through.
#define PALPATE_FLAG_MOVED_TOO_FAR 4096

// The array that palpate_skin_export exports: the positions of skin vertices.
#define PALPATE_SKIN_POSITIONS 0

// The array that palpate_skin_export exports: the normals of skin vertices.
#define PALPATE_SKIN_NORMALS 1

// Event of a tick (one iteration of the haptic loop): the haptic device could not be read or written; no force is
// played on it.
#define PALPATE_EVENT_DEVICE_LOST 1

// Event of a tick: a number in the device's reading was not finite, or its orientation was no rotation; the last valid
// pose is used instead.
#define PALPATE_EVENT_BAD_READING 2

// Event of a tick: the device's pose jumped further than a hand can move in a tick; the last valid pose is used until
// the force has faded out.
#define PALPATE_EVENT_POSE_JUMP 4

// Event of a tick: the device is outside its workspace; the force fades out.
#define PALPATE_EVENT_OUTSIDE_WORKSPACE 8

// Event of a tick: the latency of the newest wrench is above the limit `watchdog` (see palpate_loop_options); the
// force fades out.
#define PALPATE_EVENT_STALE_WRENCH 16

// Event of a tick: a wrench of the simulation was not finite, and was ignored.
#define PALPATE_EVENT_BAD_WRENCH 32

// Event of a tick: the clock stood still, ran backwards or jumped ahead; the force rises again from zero.
#define PALPATE_EVENT_CLOCK_JUMP 64

// Event of a tick: the tick began more than 2 ms after its deadline.
#define PALPATE_EVENT_LATE_TICK 128

// Event of a tick: only a part of the force is played, because the force is fading in (at the start of the loop, or
// after a fade-out) or fading out.
#define PALPATE_EVENT_ENGAGING 256

// Event of a tick: the tool moved so far from its pose in the newest wrench that the local model (which extrapolates
// the contact force from that pose) is no longer trusted; the contact force does not grow further.
#define PALPATE_EVENT_BEYOND_TRUST 512

// Event of a tick: the passivity controller (see palpate_loop_options) damped the force.
#define PALPATE_EVENT_DAMPED 1024

// Event of a tick: the passivity controller wanted more damping than the haptic device can play stably.
#define PALPATE_EVENT_DAMPING_LIMITED 2048

// Event of a tick: the force or the torque exceeded its limit, and was reduced to that limit.
#define PALPATE_EVENT_CLAMPED 4096

// Event of a tick: the force or the torque changed faster than the limit on its rate of change allows, so only a part
// of the change was played.
#define PALPATE_EVENT_SLEW_LIMITED 8192

// Event of a tick: the force to be played was not finite; no force was played.
#define PALPATE_EVENT_BAD_FORCE 16384

// Event of a tick: the ticks directly before this one were not reported, because a step of the simulation took so long
// that the buffer of ticks overflowed.
#define PALPATE_EVENT_RECORD_LOST 32768

// Event of a tick: the contact force changes to that of the newest wrench more slowly than usual, because the contact
// of that wrench stores more energy than the user's hand has supplied.
#define PALPATE_EVENT_UNPAID 65536

// Result of a call. If a call returns another status than PALPATE_STATUS_OK, it changed nothing, unless the
// description of the function says otherwise, and `palpate_last_error` returns one line that describes the error and
// what to do about it.
enum palpate_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The call succeeded.
    PALPATE_STATUS_OK = 0,
    // A pointer or handle that must not be null is null.
    PALPATE_STATUS_NULL = 1,
    // A handle is no valid handle of the required kind: it was destroyed, was never created, or stands for an object
    // of another kind.
    PALPATE_STATUS_HANDLE = 2,
    // A value is not allowed: it is not finite or out of range, or a struct has a wrong size.
    PALPATE_STATUS_ARGUMENT = 3,
    // An array of the caller is too small; the call wrote the number of elements that it needs to the caller's
    // variable for that number.
    PALPATE_STATUS_TOO_SMALL = 4,
    // The object of a handle is in use by another call, a submitted step (for which its caller does not wait) or a
    // haptic loop; or a callback called a function that would wait for the callback's own loop.
    PALPATE_STATUS_BUSY = 5,
    // A scene, or a file that a scene names, has an error.
    PALPATE_STATUS_INPUT = 6,
    // A file could not be written.
    PALPATE_STATUS_OUTPUT = 7,
    // No Vulkan device can be used, or the haptic device cannot be opened.
    PALPATE_STATUS_NO_DEVICE = 8,
    // The memory of the Vulkan device does not suffice, or a thread cannot be started.
    PALPATE_STATUS_MEMORY = 9,
    // A Vulkan call failed.
    PALPATE_STATUS_VULKAN = 10,
    // The simulation can do no further step.
    PALPATE_STATUS_SIMULATION = 11,
    // The library itself has a fault. The object on which the call worked may only be destroyed.
    PALPATE_STATUS_FAULT = 12,
    // The caller's callback cancelled the call.
    PALPATE_STATUS_CANCELLED = 13,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum palpate_status palpate_status;
#else
typedef int32_t palpate_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Kind of a Vulkan device.
enum palpate_device_kind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // None of the kinds below.
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

// A context: an open Vulkan device. A simulation holds on to its context, so the device stays open until the context
// is destroyed and the last simulation on it is gone.
typedef struct palpate_context palpate_context;

// A haptic loop: at the loop's rate (1000 Hz unless the scene or the options set another) a haptic device, or one for
// each of several tools, is read and a force is played on it, and meanwhile a simulation does steps.
typedef struct palpate_loop palpate_loop;

// A scene: the description of bodies, tool and settings, from which any number of simulations can be made. It is read
// from a file or a text, or built by calls. The mesh files that it names are opened when its bodies are prepared.
typedef struct palpate_scene palpate_scene;

// A simulation, which moves the bodies and the tool of a scene step by step.
typedef struct palpate_simulation palpate_simulation;

// A Vulkan device of this machine. Strings that are too long for their arrays are cut off; all end with a zero byte.
typedef struct palpate_device {
    // Kind of the device.
    palpate_device_kind kind;
    // 1: palpate can use the device; 0: palpate cannot use it, and `reason` says why.
    uint32_t usable;
    // The driver's name for the device. `device` in palpate_context_options takes this name, a part of it, or the
    // position of the device in the list of `palpate_devices`, from 0.
    char name[256];
    // Name and version of the driver.
    char driver[256];
    // Why palpate cannot use the device; "" where it can.
    char reason[256];
} palpate_device;

// Log callback: receives `user`, the pointer that was given along with the callback; `level`, one of PALPATE_LOG_*;
// and `message`, one line of text that is valid until the callback returns. The callback may be called on any thread,
// within a call of this library or of the Vulkan driver. It must not call the library, and must return normally, not
// by longjmp or an exception.
typedef void (*palpate_log)(void *user, uint32_t level, const char *message);

// Options for opening a context. In every field but `size`, zero (or null) is the default.
typedef struct palpate_context_options {
    // Size of the struct in bytes: sizeof(palpate_context_options).
    uint32_t size;
    // 1: switches the Khronos validation layer on, with synchronisation validation; its messages go to `log`. This is
    // slow. 0: off.
    uint32_t validation;
    // Device to open: its position in the list of `palpate_devices`, from 0, as a decimal number, or part of its name;
    // null: the first usable one in the order discrete GPU, integrated GPU, virtual GPU, CPU.
    const char *device;
    // Callback that receives the library's messages; null: they are discarded.
    palpate_log log;
    // Pointer that is passed to `log`.
    void *log_user;
    // Folder where prepared bodies, compiled pipelines and measurements of devices are kept for later runs; "": the
    // user's cache folder (PALPATE_CACHE, else palpate in XDG_CACHE_HOME or ~/.cache). Null: nothing is kept.
    const char *cache;
    // 1: the library measures which of two implementations is faster on the device, where the scene does not choose:
    // arrays read through texel or through storage buffers, and penetration depths computed by compute or by graphics
    // pipelines. It measures once per context, or once per device if there is a cache. 0: the library does not
    // measure.
    uint32_t measure;
    // Number of threads that lavapipe (Mesa's Vulkan driver for CPUs) uses in addition to the calling one; -1: none.
    // Any value but 0 sets the environment variable LP_NUM_THREADS in palpate_context_create, unless the environment
    // has it already; during that call no other thread of the process may read or write the environment. 0: the
    // environment stays as it is. Other drivers ignore LP_NUM_THREADS.
    int32_t threads;
} palpate_context_options;

// Callback that takes or releases the calling program's lock around its queue.
typedef void (*palpate_queue_lock)(void *user);

// A Vulkan device that the calling program opened. Its instance must have been created for Vulkan 1.3, and the device
// with the features scalarBlockLayout, synchronization2, dynamicRendering and maintenance4. All handles must stay
// valid until the context made from them and the last simulation on that context are gone.
typedef struct palpate_vulkan {
    // Size of the struct in bytes: sizeof(palpate_vulkan).
    uint32_t size;
    // Further features that the device was created with: a sum of PALPATE_VULKAN_*. Do not add a feature that is not
    // enabled.
    uint32_t enabled;
    // vkGetInstanceProcAddr of the Vulkan loader that the handles come from; null: the system's loader is opened.
    void (*get_instance_proc_addr)(void);
    // The program's VkInstance.
    void *instance;
    // The VkPhysicalDevice of `device`.
    void *physical_device;
    // The program's VkDevice.
    void *device;
    // A VkQueue of `device`. The library submits to the queue in every call that steps a simulation or copies its
    // data, and waits for that work.
    void *queue;
    // Index of the queue's family, which must have graphics and compute.
    uint32_t queue_family;
    // Reserved: must be 0.
    uint32_t reserved;
    // Takes the program's lock before each use of the queue; `unlock` releases the lock afterwards on the same thread,
    // which may be any thread. The lock is held only briefly. Neither callback may call the library, and the program
    // must not hold the lock when it calls the library, unless the lock is recursive. If both callbacks are null, the
    // program must not use the queue during any call of the library, and must create at most one context on the queue.
    palpate_queue_lock lock;
    // Releases the program's lock; see `lock`.
    palpate_queue_lock unlock;
    // Pointer that is passed to `lock` and `unlock`.
    void *lock_user;
    // Callback that receives the library's messages; null: they are discarded.
    palpate_log log;
    // Pointer that is passed to `log`.
    void *log_user;
    // Cache folder; see `cache` in palpate_context_options.
    const char *cache;
    // 1: where the library has two implementations of a computation, it measures which is faster on the device; see
    // `measure` in palpate_context_options.
    uint32_t measure;
} palpate_vulkan;

// Settings of a whole scene: the tables `[step]`, `[solver]` and `[contact]` of a scene file. In every field but
// `size`, zero is the default. A projected area is an area of a body's surface projected along the contact normal.
typedef struct palpate_settings {
    // Size of the struct in bytes: sizeof(palpate_settings).
    uint32_t size;
    // Number of Newton iterations per step; 0: 1 iteration.
    uint32_t newton;
    // Time step, s; 0: 0.001.
    double dt;
    // Acceleration of gravity, m/s^2; all zero: 0, -9.81, 0.
    double gravity[3];
    // 1: there is no gravity, and `gravity` must be zero. 0: there is gravity.
    uint32_t weightless;
    // Greatest number of conjugate gradient iterations per solve; 0: 200.
    uint32_t max_iterations;
    // Relative residual at which the solver stops; 0: between 1e-2 and 1e-5, by the error of the time step.
    double tolerance;
    // Penalty stiffness per projected area, N/m^3; 0: chosen from the bodies' materials.
    double contact_stiffness;
    // Penalty damping per projected area, N s/m^3; 0: chosen from the stiffness.
    double contact_damping;
    // Coulomb friction coefficient; 0: no friction.
    double friction;
    // Sliding speed below which friction is viscous, m/s; 0: 0.001.
    double friction_speed;
    // Penetration depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m; 0: 0.02.
    double depth_limit;
} palpate_settings;

// A pose in world coordinates.
typedef struct palpate_pose {
    // Position, m.
    double position[3];
    // Orientation, a unit quaternion: x, y, z, w.
    double orientation[4];
} palpate_pose;

// A keyframe: a pose at a time.
typedef struct palpate_key {
    // Time of the key, s; later than the time of the previous key.
    double time;
    // World pose at that time; an orientation of four zeros is no rotation.
    struct palpate_pose pose;
} palpate_key;

// A rigid core of a soft body: the nodes of the body's layer (its tetrahedral simulation mesh) that are attached to
// the core move as one rigid body. Exactly one of `inset`, the box, the sphere, `nodes` and `all` selects these nodes;
// coordinates and lengths are those of the mesh, before scale and pose.
typedef struct palpate_core {
    // Size of the struct in bytes: sizeof(palpate_core).
    uint32_t size;
    // How the core moves: PALPATE_MOTION_*.
    uint32_t motion;
    // Name of the core, different from those of the body's other cores.
    const char *name;
    // Keyframes of a driven core, `key_count` of them. As in a scene file, each is a world pose of the body's
    // coordinate frame, with which the core moves rigidly: a key that equals the body's position and orientation puts
    // the core at its place in the undeformed body. Null for other cores.
    const struct palpate_key *keys;
    // Number of elements of `keys`.
    size_t key_count;
    // Mass of a dynamic core, kg; 0: the mass of the part of the body that is attached to the core.
    double mass;
    // Selects nodes at least this deep below the skin (the body's surface mesh), m; above 0.
    double inset;
    // Selects nodes in a box: its corner of least coordinates.
    double box_low[3];
    // Corner of greatest coordinates of that box.
    double box_high[3];
    // Selects nodes in a sphere: its centre.
    double sphere_centre[3];
    // Radius of that sphere, m.
    double sphere_radius;
    // Selects single nodes by their indices in the layer, `node_count` of them.
    const uint32_t *nodes;
    // Number of elements of `nodes`.
    size_t node_count;
    // 1: selects every node.
    uint32_t all;
    // Reserved: must be 0.
    uint32_t reserved;
} palpate_core;

// A body of one of three kinds. Soft: it has a material and a layer, the tetrahedral simulation mesh (handed over,
// made of cells that fill the surface, or a box); its surface mesh, the skin, is `surface`, or else the layer's
// boundary. Rigid: it has a surface and no layer. A plane: it has `plane` and nothing else but a name. A field that is
// zero or null means what a missing key means in a scene file.
typedef struct palpate_body {
    // Size of the struct in bytes: sizeof(palpate_body).
    uint32_t size;
    // How a rigid body moves: PALPATE_MOTION_*.
    uint32_t motion;
    // Name of the body: letters, digits, '_', '-' and '.'; different from other bodies' names and from "tool".
    const char *name;
    // Name of the surface that is the body's skin, as given to `palpate_scene_add_surface`.
    const char *surface;
    // Layer, first way: name of a mesh, as given to `palpate_scene_add_layer`.
    const char *layer;
    // Layer, second way: cells that fill the surface; their edge, m, in the coordinates of the surface before `scale`.
    double cell;
    // Instead of `cell`: number of such cells along the surface's largest extent.
    uint32_t across;
    // Edge of the largest cells deep inside, as a multiple of the edge of the cells at the surface: 1, 2, 4 or 8; 0
    // means 1.
    uint32_t grade;
    // Depth below the surface to which cells fill the body, as a shell, m, in the coordinates of the surface before
    // `scale`; 0: cells fill the whole inside.
    double thickness;
    // Layer, third way: a box cut into cells; its corner of least coordinates.
    double box_low[3];
    // Corner of greatest coordinates of that box.
    double box_high[3];
    // Number of the box's cells along each axis.
    uint32_t box_cells[3];
    // Material law of a soft body: PALPATE_LAW_*.
    uint32_t law;
    // Volumetric strain of a soft body: PALPATE_DILATATION_*.
    uint32_t dilatation;
    // 1: a surface that would need repair is refused; 0: it is repaired.
    uint32_t strict;
    // Young's modulus, Pa. This field and the next four are the material of a soft body.
    double young;
    // Poisson's ratio, from -0.5 to below 0.5.
    double poisson;
    // Density, kg/m^3.
    double density;
    // Mass-proportional Rayleigh damping, 1/s.
    double damping_mass;
    // Stiffness-proportional Rayleigh damping, s.
    double damping_stiffness;
    // A fixed half-space with outward normal n and offset d (m); the half-space fills all x with n . x <= d.
    double plane[4];
    // Factor by which the coordinates of the body's meshes are multiplied; 0: 1.
    double scale;
    // World position of the mesh's origin, m.
    double position[3];
    // World orientation, unit quaternion x, y, z, w; four zeros are no rotation.
    double orientation[4];
    // Velocity at the start, world axes, m/s.
    double velocity[3];
    // Mass of a dynamic rigid body, kg.
    double mass;
    // Keyframes of a driven rigid body, `key_count` of them: world poses of the mesh's coordinate frame, as `position`
    // and `orientation` are. Null for other bodies.
    const struct palpate_key *keys;
    // Number of elements of `keys`.
    size_t key_count;
    // Rigid cores of a soft body, `core_count` of them; all must have the same `size`.
    const struct palpate_core *cores;
    // Number of elements of `cores`.
    size_t core_count;
    // Greatest number of convex collision proxies that cover the body for the broad phase; 0: the default.
    uint32_t hulls;
    // Reserved: must be 0.
    uint32_t reserved;
} palpate_body;

// The tool that the haptic device moves: exactly one of a sphere, a surface and a body of the scene. The last four
// fields are the virtual coupling, a spring and damper between device and tool. Without a coupling (its four fields
// zero) the tool moves freely.
typedef struct palpate_tool {
    // Size of the struct in bytes: sizeof(palpate_tool).
    uint32_t size;
    // 1: a surface that would need repair is refused; 0: it is repaired.
    uint32_t strict;
    // Radius of a spherical tool, m; 0: the tool is no sphere.
    double sphere;
    // Name of the tool's surface, as given to `palpate_scene_add_surface`; null: none.
    const char *surface;
    // Name of a body of the scene that is the tool; null: none. The virtual coupling acts on that body's first core,
    // which must be dynamic. Mass and pose of the tool are then those of the body.
    const char *body;
    // Mass of the tool, kg.
    double mass;
    // World position of the tool's centre at the start, m.
    double position[3];
    // World orientation at the start, unit quaternion x, y, z, w; four zeros are no rotation.
    double orientation[4];
    // Velocity at the start, world axes, m/s.
    double velocity[3];
    // Factor by which the surface's coordinates are multiplied; 0: 1.
    double scale;
    // Stiffness of the virtual coupling, N/m.
    double stiffness;
    // Damping of the virtual coupling, N s/m.
    double damping;
    // Angular stiffness of the virtual coupling, N m/rad.
    double angular_stiffness;
    // Angular damping of the virtual coupling, N m s/rad.
    double angular_damping;
} palpate_tool;

// Progress callback of `palpate_scene_prepare` and of `palpate_simulation_create_with_progress`, called as each stage
// begins. `body` is the name of the body that is being prepared, or "tool". `stage` is "cache" (the cache is searched
// for the prepared body), "read" (the surface is read), "repair" (the surface is repaired), "layer" (tetrahedra are
// made), "embed" (the skin is embedded in the tetrahedra), "proxies" (convex hulls are made), "bind" (nodes are attached
// to rigid cores) or "ready" (the body is ready). `done` is the number of bodies that are ready and `total` that of all
// bodies; a tool that is not one of the bodies counts as one more body. The strings are valid until the callback
// returns. Return 0 to continue, anything else to cancel. While the callback of `palpate_scene_prepare` runs, calls on
// the scene give PALPATE_STATUS_BUSY. The callback must return: no longjmp, and no exception.
typedef int32_t (*palpate_progress)(void *user, const char *body, const char *stage, uint32_t done, uint32_t total);

// Result of a step. In a scene without a tool, `force`, `torque` and the positions are zero, and the orientations are
// the identity.
typedef struct palpate_wrench {
    // Size of the struct in bytes: sizeof(palpate_wrench).
    uint32_t size;
    // Warnings about the step: PALPATE_FLAG_*, one bit each; 0: there are none.
    uint32_t flags;
    // Number of steps that the simulation has done, including this one.
    uint64_t step;
    // Simulated time at the end of the step, s.
    double time;
    // Net contact force on the tool, world axes, N.
    double force[3];
    // Net contact torque on the tool about its centre, world axes, N m.
    double torque[3];
    // Pose of the tool at the end of the step.
    struct palpate_pose tool;
    // Pose of the haptic device at the end of the step.
    struct palpate_pose device;
    // Greatest penetration depth among the contacts, m.
    double max_depth;
    // Relative residual of the linear system at the end of the last solve.
    double residual;
    // Number of contacts: vertices of one body's surface mesh that lie inside another body. Of two bodies that touch,
    // the vertices of both count, unless the scene's `contact.sides` is "one"; where triangles are tested for contact
    // (`contact.samples`), those of one body count instead.
    uint32_t contacts;
    // Number of conjugate gradient iterations in all solves of the step.
    uint32_t iterations;
} palpate_wrench;

// Force and torque by which a support, or a fixed or driven core, acts on its soft body.
typedef struct palpate_reaction {
    // Names of the body and of the support or core, with a dot between them.
    char name[208];
    // Force, world axes, N.
    double force[3];
    // Torque about the world's origin, N m.
    double torque[3];
} palpate_reaction;

// Cost of one stage of a simulation step.
typedef struct palpate_stage {
    // Name of the stage, as in docs/understanding/step.md: "pose", "cull", "skin", "depth", "contact", "elastic", "solve", "wrench"
    // and so on. In every second timed step, "pose to contact" stands for the first five of these stages, which are
    // then timed together.
    char name[32];
    // Time of the stage on the GPU in the last step, microseconds; 0 if the last step was not timed.
    double microseconds;
    // Number of dispatches, draws, fills and copies of the stage in a step with as many solver iterations as the last
    // one; 0 for "pose to contact".
    uint32_t passes;
    // Reserved: always 0.
    uint32_t reserved;
} palpate_stage;

// Parameters of an elastic material. The material law itself is chosen with the scene and cannot be changed.
typedef struct palpate_material {
    // Size of the struct in bytes: sizeof(palpate_material).
    uint32_t size;
    // Reserved: must be 0.
    uint32_t reserved;
    // Young's modulus, Pa.
    double young;
    // Poisson's ratio, from -0.5 to below 0.5.
    double poisson;
    // Density, kg/m^3.
    double density;
    // Mass-proportional Rayleigh damping, 1/s.
    double damping_mass;
    // Stiffness-proportional Rayleigh damping, s.
    double damping_stiffness;
} palpate_material;

// The contact law: penalty forces between touching bodies, with damping and friction. A projected area is an area of a
// body's surface projected along the contact normal.
typedef struct palpate_contact_law {
    // Size of the struct in bytes: sizeof(palpate_contact_law).
    uint32_t size;
    // Reserved: must be 0.
    uint32_t reserved;
    // Penalty stiffness per projected area, N/m^3; below zero: chosen from the bodies' materials.
    double stiffness;
    // Penalty damping per projected area, N s/m^3; below zero: chosen from the stiffness.
    double damping;
    // Coulomb friction coefficient.
    double friction;
    // Sliding speed below which friction is viscous, m/s.
    double friction_speed;
    // Penetration depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m.
    double depth_limit;
} palpate_contact_law;

// The virtual coupling: a spring and damper between haptic device and tool.
typedef struct palpate_coupling {
    // Size of the struct in bytes: sizeof(palpate_coupling).
    uint32_t size;
    // Reserved: must be 0.
    uint32_t reserved;
    // Stiffness of the coupling, N/m.
    double stiffness;
    // Damping of the coupling, N s/m.
    double damping;
    // Angular stiffness of the coupling, N m/rad.
    double angular_stiffness;
    // Angular damping of the coupling, N m s/rad.
    double angular_damping;
} palpate_coupling;

// The skins (surface meshes) as arrays on the Vulkan device: the vertices of all bodies one after another, those of
// the tool last. If the program itself opened the device, it can bind the buffers directly (usages: storage, texel and
// transfer; positions and normals also vertex). The buffers live as long as the simulation, with one exception: when
// palpate_contact_set switches friction on in a scene without friction, new buffers replace them, and the program must
// get the buffers again and export them again.
typedef struct palpate_skins {
    // Size of the struct in bytes: sizeof(palpate_skins).
    uint32_t size;
    // Number of the vertices of all skins together.
    uint32_t vertex_count;
    // Number of the triangles of all skins together.
    uint32_t triangle_count;
    // Reserved: always 0.
    uint32_t reserved;
    // VkBuffer of the vertex positions: four floats per vertex, x, y, z (m, relative to the `origin` passed to
    // palpate_skin_buffers) and 1.
    uint64_t positions;
    // VkBuffer of the vertex normals: four floats per vertex, the three components of a unit outward vector and 0.
    uint64_t normals;
    // VkBuffer of the triangles: four uint32_t per triangle, the indices of its three vertices counter-clockwise seen
    // from outside, and 0.
    uint64_t triangles;
} palpate_skins;

// A contact of the last step: a vertex of one body's skin that lies inside another body, or the part of a triangle that
// does, where triangles are tested for contact (scene key `contact.samples`).
typedef struct palpate_contact {
    // First the body to which the vertex or triangle belongs, then the body inside which it lies, both by their positions
    // in the scene, counted from 0; the tool is counted after the last body.
    uint32_t body[2];
    // Index of the vertex in its body's skin; of a triangle, the corner nearest to its centre of pressure.
    uint32_t vertex;
    // Reserved: always 0.
    uint32_t reserved;
    // World position of the vertex, or of the triangle's centre of pressure, at the time of the call, m.
    double position[3];
    // Contact normal: unit vector in world axes, outward from the body inside which the vertex lies.
    double normal[3];
    // Penetration depth along the normal, m; of a triangle, the mean over its part.
    double depth;
    // Area of the vertex's share of the skin, or of the triangle's part, projected along the contact normal, m^2.
    double area;
    // Contact pressure along the normal at the end of the step, Pa. `pressure` times `area` is the magnitude of the
    // normal force of this contact; if one of the bodies is the tool, this force is a part of the net force in
    // palpate_wrench. If a state was restored since the last step, `pressure` is instead that at the start of the
    // step.
    double pressure;
} palpate_contact;

// State of a haptic device in world axes, as the callback `read` reports it. Before each call the library fills every
// field as described below; the callback overwrites the fields that it knows.
typedef struct palpate_reading {
    // Size of this struct in the library, bytes: the callback must not write beyond it.
    uint32_t size;
    // Buttons, one bit each, the first in the lowest bit; 1: pressed. Filled with 0.
    uint32_t buttons;
    // Time at which the state was measured, s on the loop's clock. Filled with the time of the call.
    double time;
    // Pose of the device. The callback must write the position. The orientation is filled with the identity, which a
    // device that senses no rotation leaves as it is.
    struct palpate_pose pose;
    // Velocity, m/s. Filled with NaN; if NaN is left there, the library estimates the velocity from the positions.
    double velocity[3];
    // Angular velocity, rad/s. Filled with NaN; if NaN is left there, the library estimates the angular velocity from
    // the orientations.
    double angular_velocity[3];
} palpate_reading;

// Force and torque that a haptic device is to play until the next call of `write`, in world axes. They are always
// finite, and within the limits of the device's profile (the limits of a type of device).
typedef struct palpate_play {
    // Size of this struct in the library, bytes: the callback must not read beyond it.
    uint32_t size;
    // Reserved: always 0.
    uint32_t reserved;
    // Force on the user's hand, N.
    double force[3];
    // Torque on the user's hand about the device's position, N m; zero where the profile allows no torque.
    double torque[3];
} palpate_play;

// A haptic device made of the caller's callbacks. The callbacks run on threads of the loop, never two of one device at
// a time; those of several devices do. They return 0 on success; any other value means that the device is lost for now:
// nothing is played, and the device is tried again at the next tick. The loop ends when its device, of several all of
// them, is lost for 5 s. No callback may wait for longer than a small part of a tick, or let an exception or a longjmp
// out. `palpate_loop_stop` and `palpate_loop_destroy` called from within a callback only ask the loop to end.
typedef struct palpate_haptic_device {
    // Size of the struct in bytes: sizeof(palpate_haptic_device).
    uint32_t size;
    // Reserved: must be 0.
    uint32_t reserved;
    // Pointer that is passed to each callback; the library does not use it otherwise. What it points to must stay
    // valid until the loop has ended.
    void *user;
    // Prepares the device; called once, before the other callbacks. Null: there is nothing to prepare. If `open`
    // returns other than 0, the loop does not begin, and `close` is not called.
    int32_t (*open)(void *user);
    // Reads the state of the device at `time`, s on the loop's clock; called once per tick. The loop rejects a reading
    // that has numbers that are not finite, an orientation that is no rotation, or a pose that a hand cannot have
    // reached since the last reading.
    int32_t (*read)(void *user, double time, struct palpate_reading *reading);
    // Plays force and torque until the next call; called once per tick. Called with zero force and torque after `open`
    // and before `close`.
    int32_t (*write)(void *user, const struct palpate_play *play);
    // Releases the device; called once at the end, whatever happened, if `open` returned 0. Null: there is nothing to
    // release.
    void (*close)(void *user);
    // Name of the profile, which holds the limits of the device: "scripted", "premium", "touch", "omega.x", "delta.6",
    // "sigma.7", "falcon", "inverse3", "minverse" or "mouse" (docs/reference/scene.md). Null: the scene's
    // `haptics.profile`, for a tool after the first that of the tool.
    const char *profile;
} palpate_haptic_device;

// Options of a haptic loop. Unless its description says otherwise, a field that is 0 leaves the option at its value in
// the scene's table `[haptics]` (for a tool after the first in the table `haptics` of the tool) or, if the scene does not
// set the option, at the default of that table.
typedef struct palpate_loop_options {
    // Size of the struct in bytes: sizeof(palpate_loop_options).
    uint32_t size;
    // 1: until the simulation's next step ends, the contact force follows the tool's motion by a local model, which
    // consists of the contact force, stiffness and damping that the newest step gave. -1: the contact force stays that
    // of the newest step.
    int32_t local_model;
    // 1: the passivity controller is on: it damps the force when the loop has given the user's hand more energy than
    // it has absorbed from the hand. -1: the passivity controller is off.
    int32_t passivity;
    // Reserved: must be 0.
    uint32_t reserved;
    // Rate of the loop in ticks (iterations) per second, from 50 to 4000.
    double rate;
    // Duration of the loop, s, of several devices the shortest given; 0: the loop runs until it is stopped.
    double seconds;
    // Greatest force that is played, N. This field and the next four can only lower the limits in the profile of the
    // haptic device (the limits of its model); if a value is higher than the profile's limit, the profile's limit
    // holds, and a note of the loop reports this.
    double max_force;
    // Greatest torque that is played, N m.
    double max_torque;
    // Greatest rate of change of the played force, N/s.
    double max_slew;
    // Radius of the workspace, m: the sphere about the position at which the device was first read. Outside this
    // sphere the force fades out.
    double workspace;
    // Greatest latency of the newest wrench, s: if more time has passed since the inputs of the wrench's step were
    // taken, the force fades out.
    double watchdog;
    // Longest time step of the simulation, s. From the scene's `dt` up to this value, the loop chooses the shortest
    // time step that takes no longer to compute than it lasts. If even a step of this length takes longer to compute,
    // the loop uses this length, and bodies move slower than in real time. Of several devices the shortest holds.
    double longest_step;
} palpate_loop_options;

// State of a haptic loop; where several devices lead tools, that of one of them. It is updated after each step of the
// simulation, so its values about ticks are at most one step old. Before the first tick all fields are zero, except
// `size`, `is_running`, `notes`, `steps`, and the orientations of the poses, which are the identity.
typedef struct palpate_loop_state {
    // Size of the struct in bytes: sizeof(palpate_loop_state).
    uint32_t size;
    // 1: the loop runs; 0: the loop has ended, and the haptic device is closed.
    uint32_t is_running;
    // Status with which the loop failed; PALPATE_STATUS_OK if it has not failed. A haptic device that is lost (cannot
    // be read or written) for 5 s, of several all of them, ends the loop, but this is no failure.
    palpate_status status;
    // Number of notes (lines of text about the loop) that `palpate_loop_note` can read.
    uint32_t notes;
    // Events of the newest tick: PALPATE_EVENT_*, one bit each.
    uint32_t events;
    // All events that any tick has had so far: PALPATE_EVENT_*, one bit each.
    uint32_t events_so_far;
    // Buttons of the haptic device, one bit each; 1: pressed.
    uint32_t buttons;
    // Reserved: always 0.
    uint32_t reserved;
    // Number of ticks done.
    uint64_t ticks;
    // Number of steps that the simulation has done for the loop, including those before the first tick.
    uint64_t steps;
    // The simulation step whose wrench the newest tick used: number of that step, as `step` in palpate_wrench; 0:
    // there is no wrench yet.
    uint64_t wrench_step;
    // Number of deadlines of ticks that were missed by more than 2 ms.
    uint64_t missed;
    // Time at which the newest tick began, s since the loop began.
    double time;
    // Latency, at the newest tick, of the wrench that it used: time since the inputs of the wrench's step were taken,
    // s.
    double wrench_age;
    // Pose of the haptic device at the newest tick, as the loop uses it, that is, checked and smoothed.
    struct palpate_pose device;
    // Pose of the tool at the newest tick. The tool follows the haptic device by the virtual coupling, a spring and
    // damper.
    struct palpate_pose tool;
    // Contact force on the tool at the newest tick, from the local model, N.
    double contact_force[3];
    // Contact torque on the tool about its centre at the newest tick, from the local model, N m.
    double contact_torque[3];
    // Force that the haptic device was last commanded to play, N.
    double played_force[3];
    // Torque that the haptic device was last commanded to play, N m.
    double played_torque[3];
    // Share of the force that is played, from 0 (faded out) to 1 (the whole force).
    double gain;
    // Greatest magnitude so far of the force that was played, N.
    double peak_force;
    // 99th percentile of the lateness of ticks (time from a tick's deadline to its beginning), s. It is updated every
    // 1000 ticks and at the end of the loop.
    double late_p99;
    // Greatest lateness of a tick so far, s.
    double late_worst;
} palpate_loop_state;



#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the value of `PALPATE_ABI` with which the library was built. If it differs from the value in the header with
// which a program was compiled, the program must not use this library.
uint32_t palpate_abi(void);

// Returns the version of the library, such as "0.1.0". The string is never null and is valid as long as the program
// runs.
const char *palpate_version(void);

// Returns the message of the last failed call on this thread, that is, the last call with another status than
// PALPATE_STATUS_OK. The message is one line, or "" if no call has failed. The string is never null, and is valid
// until the next call on this thread fails.
const char *palpate_last_error(void);

// Lists the Vulkan devices of this machine, usable or not. `count` receives their number; up to `capacity` devices are
// written to `devices`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more than
// `capacity` devices, and none was written.
palpate_status palpate_devices(struct palpate_device *devices, size_t capacity, size_t *count);

// Opens a Vulkan device as a context. `options` may be null: then all options have their defaults.
palpate_status palpate_context_create(const struct palpate_context_options *options, struct palpate_context **context);

// Destroys a context. The device is closed as soon as the last simulation on the context is gone. Null does nothing.
palpate_status palpate_context_destroy(struct palpate_context *context);

// Reads how many bytes of the device's memory the arrays of all simulations on a context occupy.
palpate_status palpate_context_memory(struct palpate_context *context, uint64_t *bytes);

// Makes a context on a Vulkan device of the calling program; the device stays open when the context is destroyed. The
// library checks what it can: that the physical device belongs to the instance and can run palpate, and that the
// queue's family has graphics and compute. It cannot detect invalid handles, or features that were not enabled.
palpate_status palpate_context_create_on(const struct palpate_vulkan *vulkan, struct palpate_context **context);

// Makes a scene from the scene file at the path `file`.
palpate_status palpate_scene_load(const char *file, struct palpate_scene **scene);

// Makes a scene from a text in the format of a scene file. Relative paths in the text are relative to `folder`, or, if
// `folder` is null, to the working directory.
palpate_status palpate_scene_parse(const char *text, const char *folder, struct palpate_scene **scene);

// Destroys a scene. Simulations that were made of the scene can still be used. With null the call does nothing.
palpate_status palpate_scene_destroy(struct palpate_scene *scene);

// Makes an empty scene, to which the functions below add. `settings` may be null: then all settings have their
// defaults. Relative paths in a text that palpate_scene_add adds to the scene are relative to the working directory.
palpate_status palpate_scene_create(const struct palpate_settings *settings, struct palpate_scene **scene);

// Adds the tables of a text in the format of a scene file, for everything that has no field in the structs of this
// header, such as joints, material regions (parts of a layer with a material of their own), skeletons (files of bones,
// which become rigid cores), probes (points of a skin whose paths are recorded) and `[haptics]`. Bodies and probes are
// appended to the existing ones; other tables and keys replace the existing ones, and those that the text leaves out
// stay. A body in the text may name a mesh by `surface = { mesh = "name" }` if palpate_scene_add_surface has handed it
// over, or by `layer = { mesh = "name" }` if palpate_scene_add_layer has.
palpate_status palpate_scene_add(struct palpate_scene *scene, const char *text);

// Hands over a triangle surface in place of a file, under a name by which bodies and the tool refer to it.
// `vertices`: 3 * `vertex_count` coordinates; multiplied by the body's `scale` they are in m. `triangles`: 3 *
// `triangle_count` vertex indices from 0; seen from outside, each triangle is counter-clockwise. Defects of the
// surface are repaired when bodies are prepared. The name must differ from those of other surfaces, and may be any
// text but "".
palpate_status palpate_scene_add_surface(struct palpate_scene *scene,
                                         const char *name,
                                         const double *vertices,
                                         size_t vertex_count,
                                         const uint32_t *triangles,
                                         size_t triangle_count);

// Hands over the tetrahedra of a layer (the simulation mesh of a soft body) in place of a mesh file, under a name by
// which bodies refer to it. `nodes`: 3 * `node_count` coordinates; multiplied by the body's `scale` they are in m.
// `tetrahedra`: 4 * `tetrahedron_count` node indices from 0; inverted tetrahedra are reoriented, and tetrahedra
// without volume or given twice are refused. The name must differ from those of other layers, and may be any text but
// "".
palpate_status palpate_scene_add_layer(struct palpate_scene *scene,
                                       const char *name,
                                       const double *nodes,
                                       size_t node_count,
                                       const uint32_t *tetrahedra,
                                       size_t tetrahedron_count);

// Adds a body. `index` receives the position of the body in the scene, from 0, and may be null. Error messages name a
// wrong value by the value's key in a scene file: `body.NAME.material.young` stands for the field `young`.
palpate_status palpate_scene_add_body(struct palpate_scene *scene, const struct palpate_body *body, uint32_t *index);

// Sets the bodies with which the body at position `body` in the scene collides: `names` are `count` names of bodies of
// the scene, with "tool" for the tool. If `names` is null, the body collides with every other body, which is the
// default. Two bodies collide if each of them has the other in its list or has no list; with an empty list (`count` 0,
// `names` not null) a body collides with nothing. Two tools that are bodies collide only if one of them has a list.
palpate_status palpate_scene_set_collides(struct palpate_scene *scene,
                                          uint32_t body,
                                          const char *const *names,
                                          size_t count);

// Sets the scene's tool, and the virtual coupling (spring and damper) between haptic device and tool. Both replace
// those that the scene has; of several tools (`[[tool]]`) all are removed.
palpate_status palpate_scene_set_tool(struct palpate_scene *scene, const struct palpate_tool *tool);

// Sets the folder in which palpate_scene_prepare keeps prepared bodies for later runs; "": the user's cache folder
// (see `cache` in palpate_context_options); null, which is the default: prepared bodies are not kept.
palpate_status palpate_scene_cache(struct palpate_scene *scene, const char *folder);

// Prepares the bodies of a scene: repairs surfaces, fills them with tetrahedra, and does the other stages that
// palpate_progress lists. This takes seconds, unless prepared bodies are found in the cache (palpate_scene_cache).
// Bodies that were not prepared by this call are prepared when a simulation is made.
// `progress` is called with `user` on this thread as each stage begins; it may be null. If the callback cancels
// (PALPATE_STATUS_CANCELLED), bodies that are ready stay ready, and the next call continues with the others.
palpate_status palpate_scene_prepare(struct palpate_scene *scene, palpate_progress progress, void *user);

// Makes a simulation of a scene on a context. The call prepares the bodies that palpate_scene_prepare has not
// prepared, compiles the GPU kernels that the context has not compiled before, and records the GPU commands of a step.
// All of it can take a minute where nothing is in a cache; palpate_simulation_create_with_progress tells how far it is.
// Afterwards the scene may be destroyed.
palpate_status palpate_simulation_create(struct palpate_context *context,
                                         struct palpate_scene *scene,
                                         struct palpate_simulation **simulation);

// Makes a simulation as palpate_simulation_create does, and calls `progress` with `user` on this thread: as
// palpate_progress describes for the bodies, and then, with an empty `body` and the stage "kernels", before each GPU
// kernel that is compiled; there `done` is the number of those compiled so far, and `total` is 0, since their number is
// not known before. `progress` may be null. If the callback cancels (PALPATE_STATUS_CANCELLED), no simulation is made;
// the next call does not compile again what the context has compiled, but prepares again what neither
// palpate_scene_prepare nor a cache has kept.
palpate_status palpate_simulation_create_with_progress(struct palpate_context *context,
                                                       struct palpate_scene *scene,
                                                       palpate_progress progress,
                                                       void *user,
                                                       struct palpate_simulation **simulation);

// Destroys a simulation, after waiting for a step of palpate_step_submit that is under way. If a haptic loop uses the
// simulation, the simulation is destroyed when the loop ends. With null the call does nothing.
palpate_status palpate_simulation_destroy(struct palpate_simulation *simulation);

// Does one step, whose length is the scene's `dt`, and waits for the step to end. `device`: pose of the haptic device
// at the end of the step, which it reaches at constant speed from its pose at the start; null: the pose on the scene's
// trajectory (`[drive]`), or, if an earlier call gave a pose, the last pose given. `wrench` receives the result, and
// may be null. After a step that fails in Vulkan or in the solver, the simulation can be read and destroyed, and
// further steps give PALPATE_STATUS_SIMULATION until a saved state is restored.
palpate_status palpate_step(struct palpate_simulation *simulation,
                            const struct palpate_pose *device,
                            struct palpate_wrench *wrench);

// Tells in `count` how many tools the scene of a simulation has: 0 without a tool, more than 1 where the scene lists
// several (`[[tool]]`).
palpate_status palpate_tool_count(struct palpate_simulation *simulation, uint32_t *count);

// Does one step as palpate_step does, and leads the haptic device of each tool: to the `count` poses `devices`, one for
// each tool in the scene's order. palpate_step leads that of the first tool; the devices of the others then follow their
// trajectories (`drive`), or stay at the last poses that this function gave them; so they do in a submitted step and in
// a haptic loop. palpate_tool_wrench reads the results.
palpate_status palpate_step_tools(struct palpate_simulation *simulation,
                                  const struct palpate_pose *devices,
                                  size_t count);

// Reads what the last finished step, of whatever function or haptic loop, left of a tool: `tool` is its position in the
// scene, from 0. Force, torque and poses of `wrench` are those of this tool; its other fields are those of the step.
// Before the first step, and after a saved state was restored, all of it is zero, and orientations are the identity.
palpate_status palpate_tool_wrench(struct palpate_simulation *simulation, uint32_t tool, struct palpate_wrench *wrench);

// Copies the world positions of the nodes of a soft body's layer (its tetrahedral mesh), m: three numbers per node, in
// the order of the layer. `body` is the body's position in the scene, from 0. `count` receives the number of nodes,
// which is 0 if the body is not soft. `positions` has room for `capacity` nodes, and may be null if `capacity` is 0.
// PALPATE_STATUS_TOO_SMALL: there are more nodes than `capacity`, and none was written.
palpate_status palpate_nodes(struct palpate_simulation *simulation,
                             uint32_t body,
                             double (*positions)[3],
                             size_t capacity,
                             size_t *count);

// Copies Cauchy's stress in each tetrahedron of a soft body's layer after the last step, Pa, world axes: xx, yy, zz, xy,
// yz, xz, in the order of the layer. The stress is that of the material's law, with the penalty on compression below a
// stretch of 0.3, without damping; it is zero in a tetrahedron that is flat or inside out. `body` is the body's position
// in the scene, from 0. `count` receives the number of tetrahedra, which is 0 if the body is not soft. `stresses` has
// room for `capacity` of them, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more tetrahedra
// than `capacity`, and none was written.
palpate_status palpate_stresses(struct palpate_simulation *simulation,
                                uint32_t body,
                                double (*stresses)[6],
                                size_t capacity,
                                size_t *count);

// Lists the reactions of the last step: of each fixed or driven core, and then each support, of each body whose scene
// asks for them; none before the first step, and after a state was restored. `count` receives their number;
// `reactions` has room for `capacity` of them, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are
// more reactions than `capacity`, and none was written.
palpate_status palpate_reactions(struct palpate_simulation *simulation,
                                 struct palpate_reaction *reactions,
                                 size_t capacity,
                                 size_t *count);

// Begins a step without waiting for it: a worker thread of the simulation does the step. The first call of this
// function starts the thread. `device` has the meaning that it has in `palpate_step`; it may be null, and is copied.
// Until the step is done, functions that read or change the simulation, this one included, give PALPATE_STATUS_BUSY;
// only `palpate_step_poll`, `palpate_step_wait` and `palpate_wrench_newest` can be used. A submitted step gives the
// same bits as a step by `palpate_step`.
palpate_status palpate_step_submit(struct palpate_simulation *simulation, const struct palpate_pose *device);

// Reads whether the submitted step is done; never waits. `is_done` receives 0 while a submitted step is under way, and
// otherwise 1. If a submitted step failed, the call returns the status that `palpate_step` would have returned for
// that step; all later calls return this status too, until a saved state is restored, because before that no further
// step is possible.
palpate_status palpate_step_poll(struct palpate_simulation *simulation, int32_t *is_done);

// Waits until no submitted step is under way. If a submitted step failed, the call returns the status of that step, as
// `palpate_step_poll` does.
palpate_status palpate_step_wait(struct palpate_simulation *simulation);

// Reads the wrench of the newest finished step, which `palpate_step_submit`, `palpate_step` or a haptic loop began.
// The call never waits; any thread may make it at any time. `age_seconds` receives the age of the wrench, s: the time
// since its step received the pose of the haptic device, which was when `palpate_step_submit` or `palpate_step` was
// called, or when the loop began the step. `age_seconds` may be null. Before the first step, and after a saved state
// was restored, the wrench has `step` 0, and its age is infinite. If a submitted step failed, wrench and age are
// written nevertheless, and the call returns the status of that step.
palpate_status palpate_wrench_newest(struct palpate_simulation *simulation,
                                     struct palpate_wrench *wrench,
                                     double *age_seconds);

// Saves the state of a simulation, that is, everything that the next step starts from: positions and velocities of all
// bodies and the tool, and the data that the solver and the broad phase of collision detection carry over from step to
// step. Settings (materials, contact law, virtual coupling) are not part of the state. Call the function between two
// steps; it copies arrays from the GPU. `size` receives the number of bytes, which changes by some hundreds of bytes
// from step to step; so ask for the size just before saving. `bytes` has room for `capacity` bytes, and may be null if
// `capacity` is 0, which asks for the size alone. PALPATE_STATUS_TOO_SMALL: the state has more bytes than `capacity`,
// which is not 0, and none was written.
palpate_status palpate_state_save(struct palpate_simulation *simulation, uint8_t *bytes, size_t capacity, size_t *size);

// Restores a state that was saved from this simulation, or from another simulation with the same bodies, tool and
// Vulkan device, in this process or another one. If the settings too are the same, the next steps compute the same
// bits as the steps after the state was saved. PALPATE_STATUS_ARGUMENT: the bytes were not saved by this version of
// the library, are damaged, or belong to other bodies; nothing was changed. A simulation with a failed step can do
// steps again after a state is restored.
palpate_status palpate_state_restore(struct palpate_simulation *simulation, const uint8_t *bytes, size_t size);

// Times the stages of every `steps`-th step from now on. With `steps` 0, which is the default, no step is timed. With
// some drivers a timed step takes up to a millisecond longer.
palpate_status palpate_time_every(struct palpate_simulation *simulation, uint64_t steps);

// Lists the stages of a step in the order in which they run, with the cost of each. `count` receives the number of
// stages; `stages` has room for `capacity` stages, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there
// are more stages than `capacity`, and none was written.
palpate_status palpate_stages(struct palpate_simulation *simulation,
                              struct palpate_stage *stages,
                              size_t capacity,
                              size_t *count);

// Reads a material of a soft body: `index` 0 is the material of the body itself, and 1 and above are the materials of
// the body's regions (parts with a material of their own) in the order of the scene.
palpate_status palpate_material_get(struct palpate_simulation *simulation,
                                    uint32_t body,
                                    uint32_t index,
                                    struct palpate_material *material);

// Replaces a material of a soft body from the next step on; `index` counts as in `palpate_material_get`. No body is
// prepared again, and no GPU commands are recorded again. Whether the solver's preconditioner has a coarse space (a
// second level) for the body was decided when the simulation was made, and stays so. PALPATE_STATUS_ARGUMENT: there is
// no such material, a value is out of range, or the body has several materials and the new density would move the
// body's centre of mass.
palpate_status palpate_material_set(struct palpate_simulation *simulation,
                                    uint32_t body,
                                    uint32_t index,
                                    const struct palpate_material *material);

// Reads the contact law in force; a stiffness or damping that is chosen automatically reads as -1.
palpate_status palpate_contact_get(struct palpate_simulation *simulation, struct palpate_contact_law *law);

// Replaces the contact law from the next step on. Switching friction on in a scene that had none records the GPU
// commands of the step anew, which takes about as long as making the simulation did.
palpate_status palpate_contact_set(struct palpate_simulation *simulation, const struct palpate_contact_law *law);

// Replaces the virtual coupling between haptic device and tool, of several tools the first, from the next step on; null
// removes it, and the tool moves freely.
palpate_status palpate_coupling_set(struct palpate_simulation *simulation, const struct palpate_coupling *coupling);

// Reads the pose of a rigid core of a body: the world pose of the coordinate frame of the body's mesh, as if that
// frame were fixed to the core. The cores of a body are counted from 0, with the bones of its skeleton first; a rigid
// body counts as one core.
palpate_status palpate_core_pose(struct palpate_simulation *simulation,
                                 uint32_t body,
                                 uint32_t core,
                                 struct palpate_pose *pose);

// Moves a driven (kinematic) core from its present pose to `pose` (defined as in `palpate_core_pose`) at constant
// speed, and leaves it there. The motion takes `seconds` of simulated time, or one step if a step is longer. The
// remaining keyframes of the core are discarded. Call this function before every step to animate a core.
// PALPATE_STATUS_ARGUMENT: the core is not driven.
palpate_status palpate_core_move(struct palpate_simulation *simulation,
                                 uint32_t body,
                                 uint32_t core,
                                 const struct palpate_pose *pose,
                                 double seconds);

// Copies the skin (surface mesh) of a body of any kind. `body`: position of the body in the scene, from 0; the tool is
// counted after the last body. `origin`: the world point to which positions are relative, three coordinates, m; null:
// the world's origin. `positions` (m) and `normals` (unit vectors, outward) have room for `capacity` vertices, three
// floats each; either may be null. `count` receives the number of vertices. PALPATE_STATUS_TOO_SMALL: there are more
// vertices than `capacity`, and none was written.
palpate_status palpate_skin(struct palpate_simulation *simulation,
                            uint32_t body,
                            const double *origin,
                            float (*positions)[3],
                            float (*normals)[3],
                            size_t capacity,
                            size_t *count);

// Copies the force of the last step's contacts on each vertex of a body's skin, N, world axes, in the order of the skin.
// A contact acts on the vertex that it is found at, and with the opposite force on the corners of the triangle that the
// vertex has met; or, where triangles are tested for contact, on the corners of the triangle and on no vertex of the
// rigid body that it meets. `body` is the body's position in the scene, from 0; the tool is counted after the last body.
// `count` receives the number of vertices; `forces` has room for `capacity` of them, and may be null if `capacity` is 0.
// PALPATE_STATUS_TOO_SMALL: there are more vertices than `capacity`, and none was written.
palpate_status palpate_contact_forces(struct palpate_simulation *simulation,
                                      uint32_t body,
                                      double (*forces)[3],
                                      size_t capacity,
                                      size_t *count);

// Copies the triangles of a body's skin: three vertex indices per triangle, counter-clockwise seen from outside. The
// triangles never change. `count` receives their number; `triangles` has room for `capacity` triangles, and may be
// null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more triangles than `capacity`, and none was written.
palpate_status palpate_skin_triangles(struct palpate_simulation *simulation,
                                      uint32_t body,
                                      uint32_t (*triangles)[3],
                                      size_t capacity,
                                      size_t *count);

// Computes the present skins on the Vulkan device, relative to the world point `origin` (three coordinates, m; null:
// the world's origin), and writes their buffers to `skins`; nothing is copied from the GPU. When the call returns, the
// arrays are filled; they keep their contents until the next call of this function or of `palpate_skin`, and no other
// function writes to them. GPU work of the program that reads the arrays must be submitted to the queue that the
// library uses, or must be finished before the next call of one of these two functions. The first call makes the
// arrays.
palpate_status palpate_skin_buffers(struct palpate_simulation *simulation,
                                    const double *origin,
                                    struct palpate_skins *skins);

// Reads which vertices in the arrays of `palpate_skin_buffers` belong to a body. `first` receives the index of the
// first vertex, and `count` the number of vertices. The tool is counted after the last body.
palpate_status palpate_skin_range(struct palpate_simulation *simulation,
                                  uint32_t body,
                                  uint32_t *first,
                                  uint32_t *count);

// Exports the memory of one of the arrays of `palpate_skin_buffers`, for import by another API. `which`: the array,
// PALPATE_SKIN_*. `descriptor` receives an opaque file descriptor (VK_KHR_external_memory_fd) of a dedicated
// allocation, at the start of which the array lies; `bytes` receives the size of that allocation. The caller owns the
// descriptor: a successful import takes it over, otherwise the caller must close it. The contents of the array change
// only when `palpate_skin_buffers` or `palpate_skin` is called. PALPATE_STATUS_VULKAN: the device cannot export
// memory.
palpate_status palpate_skin_export(struct palpate_simulation *simulation,
                                   uint32_t which,
                                   int32_t *descriptor,
                                   uint64_t *bytes);

// Copies the contacts of the last step, whose number is also the field `contacts` of that step's palpate_wrench.
// `count` receives their number; `contacts` has room for `capacity` contacts, and may be null if `capacity` is 0.
// PALPATE_STATUS_TOO_SMALL: there are more contacts than `capacity`, and none was written.
palpate_status palpate_contacts(struct palpate_simulation *simulation,
                                struct palpate_contact *contacts,
                                size_t capacity,
                                size_t *count);

// Starts a haptic loop. At the loop's rate `device` is read and receives the force to play; meanwhile the simulation,
// which must have a tool (of several the first is led), steps in real time, each step with the device's newest pose.
// Both happen on threads of the loop. `device` and `options` are copied; `options` may be null: then all options are
// those of the scene's `[haptics]`. The call waits for five steps, which measure how long a step takes, and for the
// device to open; PALPATE_STATUS_NO_DEVICE: the device did not open. `the_loop` is set before the first callback is
// called, and is set to null if no loop starts.
//
// The loop owns the simulation until the loop has ended: calls on the simulation give PALPATE_STATUS_BUSY, except
// `palpate_wrench_newest`, `palpate_step_poll` and `palpate_step_wait`. The simulation's handle may be destroyed while
// the loop runs. After the loop has ended, the simulation continues from the tool, device pose and time that the loop
// reached. Stop a loop that still runs before the program ends.
palpate_status palpate_loop_start(struct palpate_simulation *simulation,
                                  const struct palpate_haptic_device *device,
                                  const struct palpate_loop_options *options,
                                  struct palpate_loop **the_loop);

// Starts a haptic loop as `palpate_loop_start` does, with a haptic device for each of the first `count` tools of the
// scene, in the scene's order. `devices` and `options` have `count` elements; `options` may be null: then all options
// are those of the tools' `haptics` in the scene. All devices have one clock; a fault of one leaves the forces of the
// others as they are. `palpate_loop_read_tool` and `palpate_loop_wrench_tool` read what each does.
palpate_status palpate_loop_start_tools(struct palpate_simulation *simulation,
                                        const struct palpate_haptic_device *devices,
                                        const struct palpate_loop_options *options,
                                        size_t count,
                                        struct palpate_loop **the_loop);

// Reads the state of a loop, of several tools that of the first. This function never waits; any thread may call it at
// any time, within callbacks too.
palpate_status palpate_loop_read(struct palpate_loop *the_loop, struct palpate_loop_state *state);

// Reads the state of a loop for one of the tools that it leads, as `palpate_loop_read` does for the first. `tool`: its
// position in the scene, from 0.
palpate_status palpate_loop_read_tool(struct palpate_loop *the_loop, uint32_t tool, struct palpate_loop_state *state);

// Reads the wrench of the newest step of a loop's simulation, of several tools that on the first, with the flags of
// that step, as `palpate_wrench_newest` does. Unlike that function, this one works also after the simulation's handle
// was destroyed. `age_seconds` receives the time since that step began, s; it may be null.
palpate_status palpate_loop_wrench(struct palpate_loop *the_loop, struct palpate_wrench *wrench, double *age_seconds);

// Reads the wrench of the newest step on one of the tools that a loop leads, as `palpate_loop_wrench` does on the
// first. `tool`: its position in the scene, from 0.
palpate_status palpate_loop_wrench_tool(struct palpate_loop *the_loop,
                                        uint32_t tool,
                                        struct palpate_wrench *wrench,
                                        double *age_seconds);

// Reads a note about a loop, one line of text. A note reports the virtual coupling that was chosen and why, a limit in
// the options that exceeds that of the device's profile, or that a thread of the loop has no raised priority; of
// several tools the note begins with the name of one. `note`: number of the note, from 0; `palpate_loop_state` has the
// number of notes. `count` receives the length of the text in bytes, with its terminating zero; up to `capacity` bytes
// are written to `text`, which may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL: the text is longer, and none
// of it was written.
palpate_status palpate_loop_note(struct palpate_loop *the_loop,
                                 uint32_t note,
                                 char *text,
                                 size_t capacity,
                                 size_t *count);

// Reads why a loop ended, in one line; the text is "" while the loop runs. `text`, `capacity` and `count` are those of
// `palpate_loop_note`.
palpate_status palpate_loop_ended(struct palpate_loop *the_loop, char *text, size_t capacity, size_t *count);

// Ends a loop. When the call returns, its devices play no force and are closed, and the simulation can be used again.
// State, notes and newest wrench of the loop can still be read. If the loop had failed, the call returns the status of
// that failure. A call from within a callback only asks the loop to end, and gives PALPATE_STATUS_BUSY.
palpate_status palpate_loop_stop(struct palpate_loop *the_loop);

// Stops a loop as `palpate_loop_stop` does, and destroys its handle. A call from within a callback only asks the loop
// to end, and the handle stays valid. Null does nothing.
palpate_status palpate_loop_destroy(struct palpate_loop *the_loop);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PALPATE_H */
