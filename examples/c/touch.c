/* Example: steps a scene file. Prints for each step its number, the force on the tool (x, y, z; N) and the step's
 * warning flags. The tool is the rigid body that the haptic device leads. Compile by: cc touch.c -lpalpate */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "palpate.h"

static void check(palpate_status status, const char *what) {
    if (status != PALPATE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", what, palpate_last_error());
        exit(EXIT_FAILURE);
    }
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: %s SCENE STEPS\n", argv[0]);
        return 2;
    }
    if (palpate_abi() != PALPATE_ABI) {
        fprintf(stderr, "palpate.h is not the header of this library (version %s)\n", palpate_version());
        return EXIT_FAILURE;
    }
    palpate_context *context = NULL;
    palpate_scene *scene = NULL;
    palpate_simulation *simulation = NULL;
    /* Prepared bodies and compiled pipelines, which take long to make, are kept in the user's cache folder. */
    const palpate_context_options options = {.size = sizeof options, .cache = "", .measure = 1};
    check(palpate_context_create(&options, &context), "no device");
    check(palpate_scene_load(argv[1], &scene), "no scene");
    check(palpate_simulation_create(context, scene, &simulation), "no simulation");
    check(palpate_scene_destroy(scene), "scene");

    palpate_wrench wrench = {.size = sizeof wrench};
    for (long steps = strtol(argv[2], NULL, 10); steps > 0; steps--) {
        /* With a null pose the haptic device moves as the table [drive] of the scene file says. Your program passes the
         * pose of its own device instead. */
        check(palpate_step(simulation, NULL, &wrench), "step");
        printf("%" PRIu64 " %.17g %.17g %.17g %" PRIu32 "\n", wrench.step, wrench.force[0], wrench.force[1],
               wrench.force[2], wrench.flags);
    }
    check(palpate_simulation_destroy(simulation), "simulation");
    check(palpate_context_destroy(context), "context");
    return EXIT_SUCCESS;
}
