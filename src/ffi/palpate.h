/*
 * palpate.h: feel soft bodies from any program.
 *
 * A context is a Vulkan device, a scene is what a scene file says (README, "A scene"), a simulation is a scene under way on a
 * context: pose in, wrench out, a step at a time.
 *
 * Every function gives a status. What is not PALPATE_STATUS_OK has done nothing but what its description says, and left one
 * line about what is wrong and what to do in palpate_last_error().
 *
 * Handles (palpate_context *, palpate_scene *, palpate_simulation *) are made by the functions that end in _create, _load or
 * _parse, and given back to the one that ends in _destroy, in any order: a simulation holds on to its context. A handle that
 * was destroyed is found out (PALPATE_STATUS_HANDLE), and so is null (PALPATE_STATUS_NULL). Where a handle was to be made and
 * was not, it is set to null, unless the arguments before it were wrong.
 *
 * Arrays and structs are the caller's. The library copies what it is given, writes no further than `capacity` elements or
 * `size` bytes, and keeps no pointer after a call. Structs that begin with `size` may grow: set it to sizeof the struct, and
 * the rest to zero. Strings are UTF-8 and end in a zero.
 *
 * Threads: any thread may use any handle, one at a time; a call on a handle that another is using gives PALPATE_STATUS_BUSY at
 * once. Simulations of different contexts run at the same time; those of one context take turns on its queue. The message of
 * palpate_last_error() is the thread's own.
 *
 * Units: m, kg, s, N, Pa. y is up. Quaternions are x y z w. All numbers of a pose must be finite.
 */

#ifndef PALPATE_H
#define PALPATE_H

/* Made by cbindgen from src/ffi; do not edit. */

#include <stddef.h>
#include <stdint.h>

// Number of the binary interface: raised when something that a program was compiled against changes its meaning or goes.
// Compare it with `palpate_abi()`.
#define PALPATE_ABI 1

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
    // No Vulkan device can be used.
    PALPATE_STATUS_NO_DEVICE = 8,
    // The device's memory does not suffice.
    PALPATE_STATUS_MEMORY = 9,
    // A Vulkan call failed.
    PALPATE_STATUS_VULKAN = 10,
    // The simulation cannot go on.
    PALPATE_STATUS_SIMULATION = 11,
    // A fault of the library's own. What it was at may only be destroyed.
    PALPATE_STATUS_FAULT = 12,
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

// A scene as it was read: what a simulation is made of, any number of times. Files that it names (surfaces, layers) are
// opened when it is made into a simulation.
typedef struct palpate_scene palpate_scene;

// A scene under way.
typedef struct palpate_simulation palpate_simulation;

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

// How a context is opened. Zero is right for all of it but the size.
typedef struct palpate_context_options {
    // sizeof(palpate_context_options).
    uint32_t size;
    // 0.
    uint32_t reserved;
    // Device: its position in `palpate_devices`, or part of its name; null: the best one.
    const char *device;
} palpate_context_options;

// A position and an orientation, world.
typedef struct palpate_pose {
    // m.
    double position[3];
    // Unit quaternion: x, y, z, w.
    double orientation[4];
} palpate_pose;

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

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The interface's number that the library was built with; differs from `PALPATE_ABI` where header and library do not belong
// together.
uint32_t palpate_abi(void);

// The library's version, such as "0.1.0". Never null; lives as long as the program.
const char *palpate_version(void);

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

// Reads a scene file.
palpate_status palpate_scene_load(const char *file, struct palpate_scene **scene);

// Reads a scene from the text of a scene file. `folder`: what files that it names are relative to; null: the working
// directory.
palpate_status palpate_scene_parse(const char *text, const char *folder, struct palpate_scene **scene);

// Lets go of a scene. Null does nothing.
palpate_status palpate_scene_destroy(struct palpate_scene *scene);

// Makes a simulation of a scene on a context: prepares the bodies (cached between runs, else seconds), and records the step.
// The scene may be destroyed afterwards.
palpate_status palpate_simulation_create(struct palpate_context *context,
                                         struct palpate_scene *scene,
                                         struct palpate_simulation **simulation);

// Lets go of a simulation. Null does nothing.
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

// What went wrong in the last call on this thread that did not give PALPATE_STATUS_OK, in one line; "" where none did. Never
// null; lives until the next such call on this thread.
const char *palpate_last_error(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PALPATE_H */
