// Example: moves the haptic device of a scene down, instead of along the scene's own trajectory, and prints the force
// on the tool, the rigid body that the device leads. Compile by: c++ -std=c++17 press.cpp -lpalpate
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "palpate.hpp"

int main(int argc, char **argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: %s SCENE STEPS\n", argv[0]);
        return 2;
    }
    try {
        const palpate::Context context;
        palpate::Simulation simulation(context, palpate::Scene::load(argv[1]));
        // Starts where the scene has the haptic device, and moves it down by 5 micrometres per step (5 mm/s with steps
        // of 1 ms).
        palpate::Wrench wrench = simulation.step();
        palpate::Pose device = wrench.device;
        for (long steps = std::atol(argv[2]); steps > 1; steps--) {
            device.position[1] -= 5e-6;
            wrench = simulation.step(device);
        }
        double lowest = 0.0;
        for (const auto &node : simulation.nodes(0)) {
            lowest = node[1] < lowest ? node[1] : lowest;
        }
        std::printf("%.3f N upwards on the tool after %.0f ms, %u contacts, lowest node at %.1f mm\n", wrench.force[1],
                    1e3 * wrench.time, wrench.contacts, 1e3 * lowest);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
