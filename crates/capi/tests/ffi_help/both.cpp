// Test program of palpate.hpp: does a submitted step (a step without waiting), then runs a haptic loop with a simulated
// haptic device that presses down. Prints "right" if all checks hold, and otherwise "wrong".
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <thread>

#include "palpate.hpp"

namespace {

// Data of the simulated device.
struct Hand {
    std::atomic<double> time{0.0};
    std::atomic<bool> is_closed{false};
};

int32_t read_hand(void *user, double time, palpate_reading *reading) {
    static_cast<Hand *>(user)->time = time;
    reading->pose.position[0] = 0.0;
    reading->pose.position[1] = 0.0502 - 0.004 * std::fmin(time, 1.0);
    reading->pose.position[2] = 0.0;
    return 0;
}

int32_t write_hand(void *, const palpate_play *) { return 0; }

void close_hand(void *user) { static_cast<Hand *>(user)->is_closed = true; }

} // namespace

int main(int argc, char **argv) {
    const palpate::Context context;
    palpate::Simulation simulation(context, palpate::Scene::load(argc > 1 ? argv[1] : ""));
    simulation.submit();
    simulation.wait();
    double age = -1.0;
    bool is_right = simulation.is_done() && simulation.newest(&age).step == 1 && age >= 0.0;

    Hand hand;
    palpate_haptic_device device{};
    device.user = &hand;
    device.read = read_hand;
    device.write = write_hand;
    device.close = close_hand;
    device.profile = "touch";
    {
        palpate::Loop loop(simulation, device);
        while (loop.state().peak_force < 0.05 && loop.ended().empty()) {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        }
        try {
            simulation.step();
            is_right = false;
        } catch (const palpate::Error &error) {
            is_right = is_right && error.status() == PALPATE_STATUS_BUSY;
        }
        is_right = is_right && loop.wrench(&age).step > 1 && loop.notes().at(0).find("coupling") == 0;
        loop.stop();
        is_right = is_right && hand.is_closed && loop.ended() == "it was stopped" && loop.state().is_running == 0;
        simulation.step();
        hand.is_closed = false;
        const palpate::Loop other(simulation, device);
    }
    is_right = is_right && hand.is_closed;
    hand.is_closed = false;
    {
        palpate_loop_options options{};
        options.max_force = 0.05;
        palpate::Loop third(simulation, {{device, options}});
        while (third.state(0).peak_force < 0.04 && third.ended().empty()) {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        }
        const double peak = third.state(0).peak_force;
        is_right = is_right && third.wrench(&age, 0).step > 1 && peak >= 0.04 && peak < 0.0501;
        try {
            third.wrench(&age, 1);
            is_right = false;
        } catch (const palpate::Error &error) {
            is_right = is_right && error.status() == PALPATE_STATUS_ARGUMENT;
        }
        try {
            third.state(1);
            is_right = false;
        } catch (const palpate::Error &error) {
            is_right = is_right && error.status() == PALPATE_STATUS_ARGUMENT;
        }
    }
    is_right = is_right && hand.is_closed && simulation.step().step > 2;
    const auto wrenches = simulation.step_tools({simulation.newest(&age).device});
    is_right = is_right && simulation.tool_count() == 1 && wrenches.size() == 1;
    is_right = is_right && wrenches[0].step == simulation.newest(&age).step;
    std::puts(is_right ? "right" : "wrong");
    return 0;
}
