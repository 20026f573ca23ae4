/* Example: runs a haptic loop, which reads a haptic device and plays forces on it at each tick while the simulation
 * steps. The device is this program's own: it leads the scene's tool (a rigid body) down and up again within a second.
 * Here the device is simulated; a program for real hardware has callbacks that call the hardware's driver.
 * Compile by: cc hold.c -lpalpate -lm */
#define _POSIX_C_SOURCE 199309L
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "palpate.h"

#define SECONDS 1.0 /* duration of the loop, s */
#define DEPTH 0.005 /* way of the device down from its start, m */

/* Data of the callbacks, which run on the loop's threads. The main thread reads the data only after the loop has
 * ended. */
struct hand {
    double start[3]; /* position of the device at the start, m */
    double peak;     /* greatest force played, N */
    uint64_t ticks;  /* number of forces played */
};

static int32_t read_hand(void *user, double time, palpate_reading *reading) {
    const struct hand *hand = user;
    const double turn = 2.0 * 3.14159265358979 * fmin(time / SECONDS, 1.0);
    for (int k = 0; k < 3; k++) {
        reading->pose.position[k] = hand->start[k];
    }
    reading->pose.position[1] -= 0.5 * DEPTH * (1.0 - cos(turn));
    return 0;
}

static int32_t write_hand(void *user, const palpate_play *play) {
    struct hand *hand = user;
    const double *f = play->force;
    hand->peak = fmax(hand->peak, sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
    hand->ticks++;
    return 0;
}

static void check(palpate_status status, const char *what) {
    if (status != PALPATE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", what, palpate_last_error());
        exit(EXIT_FAILURE);
    }
}

/* Waits for the end of the loop, then prints the loop's notes and why it ended. */
static void watch(palpate_loop *loop) {
    palpate_loop_state state = {.size = sizeof state};
    do {
        const struct timespec pause = {.tv_nsec = 20000000};
        nanosleep(&pause, NULL);
        check(palpate_loop_read(loop, &state), "state");
    } while (state.is_running);
    char line[512];
    size_t length = 0;
    for (uint32_t note = 0; note < state.notes; note++) {
        check(palpate_loop_note(loop, note, line, sizeof line, &length), "note");
        fprintf(stderr, "%s\n", line);
    }
    check(palpate_loop_ended(loop, line, sizeof line, &length), "end");
    printf("the loop did %" PRIu64 " ticks, %" PRIu64 " steps, and ended: %s\n", state.ticks, state.steps, line);
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: %s SCENE\n", argv[0]);
        return 2;
    }
    palpate_context *context = NULL;
    palpate_scene *scene = NULL;
    palpate_simulation *simulation = NULL;
    palpate_loop *loop = NULL;
    palpate_wrench wrench = {.size = sizeof wrench};
    /* Prepared bodies and compiled pipelines, which take long to make, are kept in the user's cache folder. */
    const palpate_context_options kept = {.size = sizeof kept, .cache = "", .measure = 1};
    check(palpate_context_create(&kept, &context), "no device");
    check(palpate_scene_load(argv[1], &scene), "no scene");
    check(palpate_simulation_create(context, scene, &simulation), "no simulation");
    check(palpate_scene_destroy(scene), "scene");
    /* The wrench of a first step contains the pose at which the scene starts the haptic device. */
    check(palpate_step(simulation, NULL, &wrench), "step");

    struct hand hand = {.peak = 0.0};
    for (int k = 0; k < 3; k++) {
        hand.start[k] = wrench.device.position[k];
    }
    const palpate_haptic_device device = {
        .size = sizeof device, .user = &hand, .read = read_hand, .write = write_hand, .profile = "touch"};
    const palpate_loop_options options = {.size = sizeof options, .seconds = SECONDS};
    check(palpate_loop_start(simulation, &device, &options, &loop), "no loop");
    watch(loop);
    check(palpate_loop_destroy(loop), "loop");
    printf("%.3f N was the greatest of %" PRIu64 " forces played\n", hand.peak, hand.ticks);
    check(palpate_simulation_destroy(simulation), "simulation");
    check(palpate_context_destroy(context), "context");
    return EXIT_SUCCESS;
}
