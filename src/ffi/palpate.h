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

// Makes a scene of nothing, for the functions below. `settings` may be null. Files that its texts name are relative to the
// working directory.
palpate_status palpate_scene_create(const struct palpate_settings *settings,
                                    struct palpate_scene **scene);

// Adds the tables of a text to a scene, as of a scene file: anything that the structs here have no fields for, such as joints,
// regions, skeletons, probes and [haptics]. Bodies and probes come after those that there are; other tables and keys replace
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

// Prepares the bodies of a scene: repairs surfaces, fills them with cells, and so on (cached between runs, else seconds).
// palpate_simulation_create does it too where it is not done, with nobody watching. `progress` is called as each stage begins,
// with `user`, on this thread; it may be null. Where it ends it (PALPATE_STATUS_CANCELLED), bodies that are ready stay so, and
// the next call goes on.
palpate_status palpate_scene_prepare(struct palpate_scene *scene,
                                     palpate_progress progress,
                                     void *user);

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

// Makes a simulation of a scene on a context: prepares the bodies where palpate_scene_prepare has not, and records the step.
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
