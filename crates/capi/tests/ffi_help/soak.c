/* Test program for memory leaks, called as: soak SCENE STEPS. It does 1000 steps of a simulation of the scene file, and
 * then STEPS further steps. It prints the greatest y component of the force on the tool (N), and then the bytes that
 * library and driver have allocated and the memory pages in use, each first after 1000 steps and then at the end. */
#include "flat.h"

int main(int argc, char **argv) {
    if (argc != 3) {
        return 2;
    }
    palpate_context *context = NULL;
    palpate_scene *scene = NULL;
    palpate_simulation *simulation = NULL;
    check(palpate_context_create(NULL, &context));
    check(palpate_scene_load(argv[1], &scene));
    check(palpate_simulation_create(context, scene, &simulation));
    palpate_wrench wrench = {.size = sizeof wrench};
    struct memory before = memory();
    double most = 0.0;
    for (long step = 0; step < 1000 + strtol(argv[2], NULL, 10); step++) {
        if (step == 1000) {
            before = memory();
        }
        check(palpate_step(simulation, NULL, &wrench));
        most = wrench.force[1] > most ? wrench.force[1] : most;
    }
    tell(most, before, memory());
    check(palpate_simulation_destroy(simulation));
    check(palpate_scene_destroy(scene));
    check(palpate_context_destroy(context));
    return EXIT_SUCCESS;
}
