/* Test program for memory leaks, called as: rounds SCENE WARM ROUNDS STEPS. In each round it creates a simulation of
 * the scene file, does STEPS steps, and destroys the simulation. It prints the y component of the force on the tool at
 * the last step (N), and then the allocated bytes and the memory pages in use, each first after WARM rounds and then
 * after ROUNDS further rounds. */
#include "flat.h"

int main(int argc, char **argv) {
    if (argc != 5) {
        return 2;
    }
    palpate_wrench wrench = {.size = sizeof wrench};
    long warm = strtol(argv[2], NULL, 10), rounds = strtol(argv[3], NULL, 10);
    struct memory before = memory();
    for (long round = 0; round < warm + rounds; round++) {
        if (round == warm) {
            before = memory();
        }
        palpate_context *context = NULL;
        palpate_scene *scene = NULL;
        palpate_simulation *simulation = NULL;
        check(palpate_context_create(NULL, &context));
        check(palpate_scene_load(argv[1], &scene));
        check(palpate_simulation_create(context, scene, &simulation));
        for (long step = strtol(argv[4], NULL, 10); step > 0; step--) {
            check(palpate_step(simulation, NULL, &wrench));
        }
        size_t size = 0;
        check(palpate_state_save(simulation, NULL, 0, &size));
        unsigned char *state = malloc(size);
        check(palpate_state_save(simulation, state, size, &size));
        check(palpate_state_restore(simulation, state, size));
        free(state);
        size_t count = 0;
        check(palpate_contacts(simulation, NULL, 0, &count));
        palpate_skins skins = {.size = sizeof skins};
        check(palpate_skin_buffers(simulation, NULL, &skins));
        /* This call is wrong, since there is no body 77, so the library stores an error message for this thread. */
        if (palpate_nodes(simulation, 77, NULL, 0, &count) == PALPATE_STATUS_OK) {
            return EXIT_FAILURE;
        }
        check(palpate_simulation_destroy(simulation));
        check(palpate_scene_destroy(scene));
        check(palpate_context_destroy(context));
    }
    tell(wrench.force[1], before, memory());
    return EXIT_SUCCESS;
}
