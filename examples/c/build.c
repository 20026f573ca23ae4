/* Example: builds a scene without files, a soft block of tetrahedra that this program makes itself, and presses a
 * spherical tool (the rigid body that the haptic device leads) into it. Prints for each step its number, the force on
 * the tool (x, y, z; N) and the step's warning flags. Compile by: cc build.c -lpalpate */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "palpate.h"

/* CELLS: number of the block's cubic cells along each axis. SIDE: number of its nodes along each axis. EDGE: length of
 * the edges of a cell, m. */
enum { CELLS = 4, SIDE = CELLS + 1, NODES = SIDE * SIDE * SIDE, TETRAHEDRA = 6 * CELLS * CELLS * CELLS };
static const double EDGE = 0.02;

static void check(palpate_status status, const char *what) {
    if (status != PALPATE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", what, palpate_last_error());
        exit(EXIT_FAILURE);
    }
}

/* Returns the index of the node at a corner of a cell; `corner` holds its place in the grid of nodes along x, y, z. */
static uint32_t node(const int corner[3]) { return (uint32_t)((corner[2] * SIDE + corner[1]) * SIDE + corner[0]); }

/* Fills the arrays with a block whose top is at y = 0, centred in x and z. Each cell is cut into six tetrahedra (Kuhn's
 * subdivision), one for each order of the three axes: three edges, one along each axis, lead from the cell's first
 * corner to its last, and the four corners on this way are those of the tetrahedron. */
static void fill(double *nodes, uint32_t *tetrahedra) {
    static const int ways[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
    for (int k = 0; k < NODES; k++) {
        const int at[3] = {k % SIDE, k / SIDE % SIDE, k / (SIDE * SIDE)};
        nodes[3 * k] = EDGE * (at[0] - CELLS / 2);
        nodes[3 * k + 1] = EDGE * (at[1] - CELLS);
        nodes[3 * k + 2] = EDGE * (at[2] - CELLS / 2);
    }
    for (int k = 0; k < TETRAHEDRA; k++) {
        const int cell = k / 6;
        int corner[3] = {cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)};
        *tetrahedra++ = node(corner);
        for (int axis = 0; axis < 3; axis++) {
            corner[ways[k % 6][axis]]++;
            *tetrahedra++ = node(corner);
        }
    }
}

/* Progress callback: prints the body that is being prepared, the stage that begins, and how many bodies are ready.
 * Returns 0 to continue. */
static int32_t say(void *user, const char *body, const char *stage, uint32_t done, uint32_t total) {
    (void)user;
    fprintf(stderr, "%s: %s (%" PRIu32 " of %" PRIu32 " bodies ready)\n", body, stage, done, total);
    return 0;
}

static palpate_scene *build(void) {
    static double nodes[3 * NODES];
    static uint32_t tetrahedra[4 * TETRAHEDRA];
    palpate_scene *scene = NULL;
    const palpate_settings settings = {.size = sizeof settings, .dt = 0.002, .friction = 0.3};
    check(palpate_scene_create(&settings, &scene), "no scene");
    fill(nodes, tetrahedra);
    check(palpate_scene_add_layer(scene, "block", nodes, NODES, tetrahedra, TETRAHEDRA), "layer");

    /* The lowest nodes are attached to a rigid core (a rigid body inside the soft one), which is fixed. */
    const palpate_core held = {
        .size = sizeof held,
        .name = "held",
        .box_low = {-1.0, -1.0, -1.0},
        .box_high = {1.0, -0.99 * CELLS * EDGE, 1.0},
    };
    const palpate_body block = {
        .size = sizeof block,
        .name = "block",
        .layer = "block",
        .young = 2e4,
        .poisson = 0.45,
        .density = 1000.0,
        .cores = &held,
        .core_count = 1,
    };
    check(palpate_scene_add_body(scene, &block, NULL), "body");
    const palpate_tool tool = {
        .size = sizeof tool,
        .sphere = 0.02,
        .mass = 0.05,
        .position = {0.0, 0.021, 0.0},
        .stiffness = 500.0,
        .damping = 2.0,
        .angular_stiffness = 0.5,
        .angular_damping = 0.002,
    };
    check(palpate_scene_set_tool(scene, &tool), "tool");
    /* The prepared block is kept in the user's cache folder, so that the next run finds it. */
    check(palpate_scene_cache(scene, ""), "cache");
    check(palpate_scene_prepare(scene, say, NULL), "not prepared");
    return scene;
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: %s STEPS\n", argv[0]);
        return 2;
    }
    palpate_context *context = NULL;
    palpate_simulation *simulation = NULL;
    check(palpate_context_create(NULL, &context), "no device");
    palpate_scene *scene = build();
    check(palpate_simulation_create(context, scene, &simulation), "no simulation");
    check(palpate_scene_destroy(scene), "scene");

    palpate_wrench wrench = {.size = sizeof wrench};
    palpate_pose device = {.position = {0.0, 0.021, 0.0}, .orientation = {0.0, 0.0, 0.0, 1.0}};
    for (long steps = strtol(argv[1], NULL, 10); steps > 0; steps--) {
        /* The haptic device moves down by 1 cm, at 10 cm/s (0.2 mm per step of 2 ms). */
        device.position[1] -= device.position[1] > 0.011 ? 2e-4 : 0.0;
        check(palpate_step(simulation, &device, &wrench), "step");
        printf("%" PRIu64 " %.17g %.17g %.17g %" PRIu32 "\n", wrench.step, wrench.force[0], wrench.force[1],
               wrench.force[2], wrench.flags);
    }
    check(palpate_simulation_destroy(simulation), "simulation");
    check(palpate_context_destroy(context), "context");
    return EXIT_SUCCESS;
}
