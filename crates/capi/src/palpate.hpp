// palpate.hpp: classes for C++17 around the functions of palpate.h, the C interface of a GPU engine for haptic touch of
// soft bodies. All of their code is in this header. Each handle is owned by an object that destroys it, and a failed
// call throws palpate::Error. palpate.h describes each function in detail.
#ifndef PALPATE_HPP
#define PALPATE_HPP

#include <array>
#include <exception>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "palpate.h"

namespace palpate {

using Pose = palpate_pose;
using Wrench = palpate_wrench;
using Material = palpate_material;
using ContactLaw = palpate_contact_law;
using Settings = palpate_settings;
using Body = palpate_body;
using Core = palpate_core;
using Tool = palpate_tool;

/// Returns a struct whose field `size` is set and whose other fields are zero, for Settings, Body, Core and Tool.
template <typename T>
T sized() {
    T zeros{};
    zeros.size = sizeof zeros;
    return zeros;
}

/// Error of a failed call: the status that the call returned, and the message of palpate_last_error.
class Error : public std::runtime_error {
public:
    explicit Error(palpate_status status) : std::runtime_error(palpate_last_error()), status_(status) {}
    palpate_status status() const noexcept { return status_; }

private:
    palpate_status status_;
};

inline void check(palpate_status status) {
    if (status != PALPATE_STATUS_OK) {
        throw Error(status);
    }
}

namespace detail {

/// Owner of a handle of palpate.h; the owner can be moved, but not copied.
template <typename T, palpate_status (*Destroy)(T *)>
class Handle {
public:
    Handle() noexcept = default;
    explicit Handle(T *handle) noexcept : handle_(handle) {}
    Handle(Handle &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
    Handle &operator=(Handle &&other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    Handle(const Handle &) = delete;
    Handle &operator=(const Handle &) = delete;
    ~Handle() { Destroy(handle_); }
    /// Returns the handle itself, for functions of palpate.h.
    T *get() const noexcept { return handle_; }

protected:
    T *handle_ = nullptr;
};

} // namespace detail

/// An open Vulkan device.
class Context : public detail::Handle<palpate_context, palpate_context_destroy> {
public:
    /// Opens a Vulkan device. `device`: a part of its name, or its position in the list of palpate_devices; if it is
    /// empty, the best device is opened. `cache`: the cache folder, as in palpate_context_options; if it is not null,
    /// the library also measures, where it has two implementations of a computation, which is faster on the device.
    explicit Context(const std::string &device = {}, const char *cache = nullptr) {
        palpate_context_options options{};
        options.size = sizeof options;
        options.device = device.empty() ? nullptr : device.c_str();
        options.cache = cache;
        options.measure = cache != nullptr;
        check(palpate_context_create(&options, &handle_));
    }
};

/// A scene: bodies, the tool (the rigid body that the haptic device leads) and settings. Simulations are made from it.
class Scene : public detail::Handle<palpate_scene, palpate_scene_destroy> {
public:
    /// Makes a scene from a scene file.
    static Scene load(const std::string &file) {
        palpate_scene *scene = nullptr;
        check(palpate_scene_load(file.c_str(), &scene));
        return Scene(scene);
    }
    /// Makes a scene from the text of a scene file; relative paths in the text are relative to `folder`.
    static Scene parse(const std::string &text, const std::string &folder = {}) {
        palpate_scene *scene = nullptr;
        check(palpate_scene_parse(text.c_str(), folder.c_str(), &scene));
        return Scene(scene);
    }
    /// Makes an empty scene with default settings.
    Scene() { check(palpate_scene_create(nullptr, &handle_)); }
    /// Makes an empty scene with these settings.
    explicit Scene(const Settings &settings) { check(palpate_scene_create(&settings, &handle_)); }
    /// Adds to the scene the tables of a text in the format of a scene file.
    void add(const std::string &text) { check(palpate_scene_add(get(), text.c_str())); }
    /// Hands over a surface, to which bodies refer by `name`: three coordinates (m) per vertex and three vertex indices
    /// per triangle.
    void add_surface(const std::string &name, const std::vector<double> &vertices,
                     const std::vector<uint32_t> &triangles) {
        check(palpate_scene_add_surface(get(), name.c_str(), vertices.data(), rows(vertices, 3, "vertices"),
                                        triangles.data(), rows(triangles, 3, "triangles")));
    }
    /// Hands over a layer (the tetrahedral mesh of a soft body), to which bodies refer by `name`: three coordinates (m)
    /// per node and four node indices per tetrahedron.
    void add_layer(const std::string &name, const std::vector<double> &nodes,
                   const std::vector<uint32_t> &tetrahedra) {
        check(palpate_scene_add_layer(get(), name.c_str(), nodes.data(), rows(nodes, 3, "nodes"), tetrahedra.data(),
                                      rows(tetrahedra, 4, "tetrahedra")));
    }
    /// Adds a body and returns its position in the scene, counted from 0; other functions name the body by this number.
    uint32_t add(const Body &body) {
        uint32_t index = 0;
        check(palpate_scene_add_body(get(), &body, &index));
        return index;
    }
    /// Sets the names of the bodies with which a body collides.
    void set_collides(uint32_t body, const std::vector<const char *> &names) {
        static const char *const none = nullptr;
        check(palpate_scene_set_collides(get(), body, names.empty() ? &none : names.data(), names.size()));
    }
    /// Sets the tool and its virtual coupling (a spring and damper between haptic device and tool).
    void set_tool(const Tool &tool) { check(palpate_scene_set_tool(get(), &tool)); }
    /// Sets the folder that keeps prepared bodies (see prepare()) for later runs; "": the user's cache folder.
    void cache(const std::string &folder) { check(palpate_scene_cache(get(), folder.c_str())); }
    /// Prepares the bodies: makes their simulation meshes and collision proxies (convex hulls), which takes seconds and
    /// has several stages. As each stage begins, `progress` is called with the name of the body, the name of the stage,
    /// the number of bodies that are ready, and the number of all bodies. If `progress` returns false, the preparation
    /// is cancelled. If `progress` throws an exception, the preparation is cancelled, and the exception is thrown
    /// again.
    template <typename Progress>
    void prepare(Progress progress) {
        struct Watch {
            Progress &progress;
            std::exception_ptr thrown;
        } watch{progress, nullptr};
        const auto call = [](void *user, const char *body, const char *stage, uint32_t done, uint32_t total) -> int32_t {
            auto *watch = static_cast<Watch *>(user);
            try {
                return watch->progress(body, stage, done, total) ? 0 : 1;
            } catch (...) {
                watch->thrown = std::current_exception();
                return 1;
            }
        };
        const palpate_status status = palpate_scene_prepare(get(), call, &watch);
        if (watch.thrown) {
            std::rethrow_exception(watch.thrown);
        }
        check(status);
    }

private:
    using Handle::Handle;

    template <typename T>
    static size_t rows(const std::vector<T> &numbers, size_t width, const char *name) {
        if (numbers.size() % width != 0) {
            throw std::invalid_argument(std::string(name) +
                                        ": the number of values is no multiple of the number of values per row");
        }
        return numbers.size() / width;
    }
};

/// A simulation, which moves the bodies and the tool of a scene step by step.
class Simulation : public detail::Handle<palpate_simulation, palpate_simulation_destroy> {
public:
    Simulation(const Context &context, const Scene &scene) {
        check(palpate_simulation_create(context.get(), scene.get(), &handle_));
    }
    /// Does one step. The haptic device follows the scene's trajectory or, once a pose was given to an earlier step,
    /// stays at the last pose given.
    Wrench step() { return step_to(nullptr); }
    /// Does one step, at the end of which the haptic device has this pose.
    Wrench step(const Pose &device) { return step_to(&device); }
    /// Does one step, at the end of which the haptic devices have these poses, one for each tool of the scene; returns the
    /// wrench of each tool.
    std::vector<Wrench> step_tools(const std::vector<Pose> &devices) {
        check(palpate_step_tools(get(), devices.data(), devices.size()));
        std::vector<Wrench> wrenches;
        for (uint32_t tool = 0; tool < devices.size(); tool++) {
            wrenches.push_back(tool_wrench(tool));
        }
        return wrenches;
    }
    /// Returns the number of tools of the scene.
    uint32_t tool_count() const {
        uint32_t count = 0;
        check(palpate_tool_count(get(), &count));
        return count;
    }
    /// Returns what the last finished step left of the tool at this position in the scene, from 0.
    Wrench tool_wrench(uint32_t tool) const {
        Wrench wrench{};
        wrench.size = sizeof wrench;
        check(palpate_tool_wrench(get(), tool, &wrench));
        return wrench;
    }
    /// Begins a step without waiting for it; the haptic device moves as in step().
    void submit() { check(palpate_step_submit(get(), nullptr)); }
    /// Begins a step without waiting for it; at the end of the step the haptic device has this pose.
    void submit(const Pose &device) { check(palpate_step_submit(get(), &device)); }
    /// Returns true if no submitted step is under way; throws the error of a failed step.
    bool is_done() const {
        int32_t is_done = 0;
        check(palpate_step_poll(get(), &is_done));
        return is_done != 0;
    }
    /// Waits until no submitted step is under way; throws the error of a failed step.
    void wait() { check(palpate_step_wait(get())); }
    /// Returns the wrench (contact force and torque on the tool) of the newest finished step; it may be called at any
    /// time, also during a step. `age` receives the time since that step received the pose of the haptic device, s.
    Wrench newest(double *age = nullptr) const {
        Wrench wrench{};
        wrench.size = sizeof wrench;
        check(palpate_wrench_newest(get(), &wrench, age));
        return wrench;
    }
    /// Returns the world positions of the nodes of a soft body's layer, m.
    std::vector<std::array<double, 3>> nodes(uint32_t body) const { return list(palpate_nodes, body); }
    /// Returns Cauchy's stress in each tetrahedron of a soft body's layer, Pa, world axes: xx, yy, zz, xy, yz, xz.
    std::vector<std::array<double, 6>> stresses(uint32_t body) const { return list(palpate_stresses, body); }
    /// Returns the contact force on each vertex of a body's skin, N, world axes; the tool is counted after the last body.
    std::vector<std::array<double, 3>> contact_forces(uint32_t body) const { return list(palpate_contact_forces, body); }
    /// Returns the world positions of the vertices of a body's skin (surface mesh), m. `body`: position of the body in
    /// the scene; the tool is counted after the last body.
    std::vector<std::array<float, 3>> skin(uint32_t body) const {
        static_assert(sizeof(std::array<float, 3>) == sizeof(float[3]), "std::array must have the layout of a C array");
        size_t count = 0;
        check(palpate_skin(get(), body, nullptr, nullptr, nullptr, 0, &count));
        std::vector<std::array<float, 3>> positions(count);
        auto *to = reinterpret_cast<float(*)[3]>(positions.data());
        check(palpate_skin(get(), body, nullptr, to, nullptr, count, &count));
        return positions;
    }
    /// Returns the contacts of the last step.
    std::vector<palpate_contact> contacts() const {
        size_t count = 0;
        check(palpate_contacts(get(), nullptr, 0, &count));
        std::vector<palpate_contact> contacts(count);
        check(palpate_contacts(get(), contacts.data(), count, &count));
        return contacts;
    }
    /// Returns the state from which the next step starts, as bytes.
    std::vector<uint8_t> save() const {
        size_t size = 0;
        check(palpate_state_save(get(), nullptr, 0, &size));
        std::vector<uint8_t> state(size);
        check(palpate_state_save(get(), state.data(), size, &size));
        return state;
    }
    /// Restores a saved state: the next steps give the same bits as the steps that followed when the state was saved.
    void restore(const std::vector<uint8_t> &state) { check(palpate_state_restore(get(), state.data(), state.size())); }
    /// Returns a material of a soft body. Index 0 is the material of the body itself; 1 and above are the materials of
    /// its regions (parts of the body with a material of their own).
    Material material(uint32_t body, uint32_t index = 0) const {
        Material material{};
        material.size = sizeof material;
        check(palpate_material_get(get(), body, index, &material));
        return material;
    }
    /// Changes a material of a soft body; `index` has the meaning that it has in material().
    void set_material(uint32_t body, const Material &material, uint32_t index = 0) {
        check(palpate_material_set(get(), body, index, &material));
    }
    /// Returns the present contact law: the parameters of the penalty forces between touching bodies.
    ContactLaw contact_law() const {
        ContactLaw law{};
        law.size = sizeof law;
        check(palpate_contact_get(get(), &law));
        return law;
    }
    void set_contact_law(const ContactLaw &law) { check(palpate_contact_set(get(), &law)); }
    /// Returns the pose of a rigid core (a rigid body inside a soft one, to which nodes are attached). palpate.h
    /// describes this pose at palpate_core_pose.
    Pose core(uint32_t body, uint32_t core) const {
        Pose pose{};
        check(palpate_core_pose(get(), body, core, &pose));
        return pose;
    }
    /// Moves a driven (kinematic) rigid core to a pose within `seconds` of simulated time.
    void move_core(uint32_t body, uint32_t core, const Pose &pose, double seconds = 0.0) {
        check(palpate_core_move(get(), body, core, &pose, seconds));
    }

private:
    /// Lists what each node, tetrahedron or vertex of a body has, by two calls of a function of palpate.h.
    template <size_t N>
    std::vector<std::array<double, N>>
    list(palpate_status (*read)(palpate_simulation *, uint32_t, double (*)[N], size_t, size_t *), uint32_t body) const {
        static_assert(sizeof(std::array<double, N>) == sizeof(double[N]), "std::array must have the layout of a C array");
        size_t count = 0;
        check(read(get(), body, nullptr, 0, &count));
        std::vector<std::array<double, N>> all(count);
        check(read(get(), body, reinterpret_cast<double (*)[N]>(all.data()), count, &count));
        return all;
    }

    Wrench step_to(const Pose *device) {
        Wrench wrench{};
        wrench.size = sizeof wrench;
        check(palpate_step(get(), device, &wrench));
        return wrench;
    }
};

/// A haptic loop: at a fixed rate it reads a haptic device, or one for each of several tools, and plays a force on it,
/// and meanwhile a simulation does steps. The destructor ends the loop and closes the devices.
class Loop : public detail::Handle<palpate_loop, palpate_loop_destroy> {
public:
    /// Starts a loop. palpate.h describes the structs `device` and `options`; the constructor sets their fields `size`.
    /// The callbacks of `device` must let no exception out.
    Loop(const Simulation &simulation, palpate_haptic_device device, palpate_loop_options options = {}) {
        device.size = sizeof device;
        options.size = sizeof options;
        check(palpate_loop_start(simulation.get(), &device, &options, &handle_));
    }
    /// Starts a loop with a device, and the options of its loop, for each of the first tools of the scene.
    Loop(const Simulation &simulation,
         const std::vector<std::pair<palpate_haptic_device, palpate_loop_options>> &tools) {
        std::vector<palpate_haptic_device> devices;
        std::vector<palpate_loop_options> options;
        for (const auto &[device, option] : tools) {
            devices.push_back(device);
            devices.back().size = sizeof device;
            options.push_back(option);
            options.back().size = sizeof option;
        }
        check(palpate_loop_start_tools(simulation.get(), devices.data(), options.data(), devices.size(), &handle_));
    }
    /// Returns the state for a tool, whose position in the scene is `tool`.
    palpate_loop_state state(uint32_t tool = 0) const {
        palpate_loop_state state{};
        state.size = sizeof state;
        check(palpate_loop_read_tool(get(), tool, &state));
        return state;
    }
    /// Returns the wrench of the simulation's newest step on a tool. `age` receives the time since that step began, s.
    Wrench wrench(double *age = nullptr, uint32_t tool = 0) const {
        Wrench wrench{};
        wrench.size = sizeof wrench;
        check(palpate_loop_wrench_tool(get(), tool, &wrench, age));
        return wrench;
    }
    /// Returns the notes about the loop, one line of text each.
    std::vector<std::string> notes() const {
        std::vector<std::string> notes(state().notes);
        for (uint32_t k = 0; k < notes.size(); k++) {
            notes[k] = text([&](char *to, size_t room, size_t *count) {
                return palpate_loop_note(get(), k, to, room, count);
            });
        }
        return notes;
    }
    /// Returns why the loop ended; an empty text while it runs.
    std::string ended() const {
        return text([&](char *to, size_t room, size_t *count) { return palpate_loop_ended(get(), to, room, count); });
    }
    /// Ends the loop, so that the simulation can be used again; throws the error with which the loop failed.
    void stop() { check(palpate_loop_stop(get())); }

private:
    /// Reads a text by two calls of `tell`, the first for the length and the second for the text; repeats both calls if
    /// the text became longer between them.
    template <typename Tell> static std::string text(const Tell &tell) {
        palpate_status status = PALPATE_STATUS_TOO_SMALL;
        std::string told;
        size_t count = 0;
        while (status == PALPATE_STATUS_TOO_SMALL) {
            check(tell(nullptr, 0, &count));
            told.resize(count);
            status = tell(&told[0], told.size(), &count);
        }
        check(status);
        told.resize(count - 1);
        return told;
    }
};

} // namespace palpate

#endif
