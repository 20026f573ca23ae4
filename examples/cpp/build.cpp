// Example: builds a scene without files, a soft spike in the shape of a tetrahedron whose foot is fixed, presses a
// spherical tool (the rigid body that the haptic device leads) onto it, and prints the force on the tool.
// Compile by: c++ -std=c++17 build.cpp -lpalpate
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <vector>

#include "palpate.hpp"

int main(int argc, char **argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: %s STEPS\n", argv[0]);
        return 2;
    }
    try {
        // The surface of the spike; the engine fills it with a tetrahedral mesh.
        const std::vector<double> vertices{-0.06, 0.0, -0.04, 0.06, 0.0, -0.04, 0.0, 0.0, 0.08, 0.0, 0.1, 0.0};
        const std::vector<uint32_t> triangles{0, 1, 2, 0, 3, 1, 1, 3, 2, 2, 3, 0};
        palpate::Scene scene;
        scene.add_surface("spike", vertices, triangles);

        // The nodes near the ground are attached to a rigid core (a rigid body inside the soft one), which is fixed.
        auto foot = palpate::sized<palpate::Core>();
        foot.name = "foot";
        foot.box_low[0] = foot.box_low[1] = foot.box_low[2] = -1.0;
        foot.box_high[0] = foot.box_high[2] = 1.0;
        foot.box_high[1] = 0.01;
        auto spike = palpate::sized<palpate::Body>();
        spike.name = spike.surface = "spike";
        spike.across = 8;
        spike.young = 5e4;
        spike.poisson = 0.4;
        spike.density = 1000.0;
        spike.cores = &foot;
        spike.core_count = 1;
        const uint32_t body = scene.add(spike);

        auto tool = palpate::sized<palpate::Tool>();
        tool.sphere = 0.02;
        tool.mass = 0.05;
        tool.position[1] = 0.121;
        tool.stiffness = 500.0;
        tool.damping = 2.0;
        scene.set_tool(tool);
        // A table of the scene that no struct describes, here a probe (a point of the surface whose path is recorded),
        // is added as text in the format of a scene file.
        scene.add("[[probe]]\nname = \"tip\"\nbody = \"spike\"\nnearest = [0.0, 0.1, 0.0]\n");
        scene.cache("");
        scene.prepare([](const char *name, const char *stage, uint32_t done, uint32_t total) {
            std::fprintf(stderr, "%s: %s (%u of %u bodies ready)\n", name, stage, done, total);
            return true;
        });

        const palpate::Context context;
        palpate::Simulation simulation(context, scene);
        palpate::Pose device{{0.0, 0.121, 0.0}, {0.0, 0.0, 0.0, 1.0}};
        palpate::Wrench wrench{};
        for (long steps = std::atol(argv[1]); steps > 0; steps--) {
            // The haptic device moves down by 1 cm, by 0.2 mm per step.
            device.position[1] -= device.position[1] > 0.111 ? 2e-4 : 0.0;
            wrench = simulation.step(device);
        }
        std::printf("%.3f N upwards on the tool; the spike has %zu nodes\n", wrench.force[1],
                    simulation.nodes(body).size());
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
