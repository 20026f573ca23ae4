/*
 * palpate.h: feel soft bodies from any program.
 *
 * A context is a Vulkan device, a scene is what a scene file says (README, "A scene"), a simulation is a scene under way on a
 * context: pose in, wrench out, a step at a time.
 *
 * Every function gives a status. What is not PALPATE_STATUS_OK has done nothing but what its description says, and left one
 * line about what is wrong and what to do in palpate_last_error().
 *
 * Handles (palpate_context *, palpate_scene *, palpate_simulation *, palpate_loop *) are made by the functions that end in
 * _create, _load, _parse or _start, and given back to the one that ends in _destroy, in any order: a simulation holds on to its context. A handle that
 * was destroyed is found out (PALPATE_STATUS_HANDLE), and so is null (PALPATE_STATUS_NULL). Where a handle was to be made and
 * was not, it is set to null, unless the arguments before it were wrong.
 *
 * Arrays and structs are the caller's. The library copies what it is given, writes no further than `capacity` elements or
 * `size` bytes, and keeps no pointer after a call. Structs that begin with `size` may grow: set it to sizeof the struct, and
 * the rest to zero. Strings are UTF-8 and end in a zero.
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

/* Made by cbindgen from src/ffi; do not edit. */

#include <stddef.h>
#include <stdint.h>

// Number of the binary interface: raised when something that a program was compiled against changes its meaning or goes.
// Compare it with `palpate_abi()`.
#define PALPATE_ABI 1

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

// Passivity control took force away, or damped.
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

// The wrench of the newest step, and when that was given its pose.
typedef struct Newest Newest;

// A Vulkan device under the library's hands. Simulations hold on to theirs: it goes with the last of them, whether it was
// destroyed before or not.
typedef struct palpate_context palpate_context;

// A haptic loop: a device held a thousand times a second, and a simulation that steps for it.
typedef struct palpate_loop palpate_loop;

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
    // What the device can do, by name: "scripted", "premium", "touch", "omega.x", "delta.6", "sigma.7", "falcon" or "inverse3"
    // (README, "The hand"). Null: the scene's `haptics.profile`.
    const char *profile;
} palpate_haptic_device;

// How a loop is run. What is 0 is as in the scene's [haptics], or as that table's default where there is none.
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

// Begins a loop: `device` is read and told what to play at the loop's rate, while the simulation, which must have a tool, steps
// in the world's time from where the device is. Both happen on threads of the loop's. `device` and `options` are copied;
// `options` may be null: all as in the scene's [haptics]. Waits for five first steps, which tell how long one takes, and for
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
// every later one, for there is no step after that.
palpate_status palpate_step_poll(struct palpate_simulation *simulation,
                                 int32_t *is_done);

// Waits until no submitted step is under way. Gives what it failed with, as `palpate_step_poll` does.
palpate_status palpate_step_wait(struct palpate_simulation *simulation);

// The wrench of the newest step that is done, whether it was submitted, a `palpate_step` or a loop's; never waits, and can be
// asked by any thread at any time. `age_seconds` receives how long ago that step was given its pose (submitted, or called for,
// or begun by the loop), s; it may be null. Before the first step the wrench has `step` 0, and its age is infinite. Where a
// submitted step failed, both are still told, and the call gives what it failed with.
palpate_status palpate_wrench_newest(struct palpate_simulation *simulation,
                                     struct palpate_wrench *wrench,
                                     double *age_seconds);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PALPATE_H */
