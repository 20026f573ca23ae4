//! Simulations: steps, what they leave, changes between them, states and pictures.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Duration;

use glam::DVec3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use palpate::internal::haptics::session::Report;
use palpate::internal::prepare::Shape;
use palpate::scene::{Coupling, Material};
use palpate::{ContactPoint, Pose, StepReport, ToolReport};
use palpate_cli::Look;
use palpate_view::Studio;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::{PlainPose, Points, numbers, plain, points, pose, rows};
use crate::context::{Context, OPENING, options};
use crate::failure::{raise, wrong};
use crate::hold::hold;
use crate::scene::Scene;
use crate::skins::{SkinCopies, view};

/// A tool after a step as Python unpacks it: force, torque, its pose, the device's pose.
type PlainTool = ([f64; 3], [f64; 3], PlainPose, PlainPose);

/// A step's report as Python unpacks it: step, time, the tools, contacts, greatest depth,
/// iterations, residual, flags, step_us, probes, reactions (name, force, torque), and the work (solves, submits, planned
/// iterations, dependent passes).
type PlainReport = (
    u64,
    f64,
    Vec<PlainTool>,
    Option<u32>,
    Option<f64>,
    u32,
    f64,
    u32,
    f64,
    Vec<[f64; 3]>,
    Vec<(String, [f64; 3], [f64; 3])>,
    (u32, u32, u32, u32),
);

/// Says which thread waits for the haptic loop, until it is dropped.
struct Held<'a>(&'a Mutex<Option<ThreadId>>);

impl Held<'_> {
    fn by_this_thread(holder: &Mutex<Option<ThreadId>>) -> Held<'_> {
        *holder.lock().unwrap_or_else(PoisonError::into_inner) = Some(thread::current().id());
        Held(holder)
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// What a run of the haptic loop reports of one device; see [`Simulation::hold`].
type PlainSession = (String, u64, u64, f64, f64, Option<String>, Vec<String>, String);

/// The contacts of a step by columns: bodies, vertex, position, normal, depth, area, pressure, friction.
type PlainContacts<'py> = (
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray1<u32>>,
    Points<'py>,
    Points<'py>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Points<'py>,
);

/// A simulation and what is made of it on demand.
struct State {
    simulation: palpate::Simulation,
    skins: Option<SkinCopies>,
    studio: Option<(Look, Studio)>,
}

/// A scene that is being simulated. Calls from several threads follow one another.
#[pyclass(frozen, module = "palpate.native")]
pub struct Simulation {
    state: Mutex<State>,
    /// The thread that waits for the haptic loop, while it runs.
    holder: Mutex<Option<ThreadId>>,
    /// Names of the bodies, by index.
    #[pyo3(get)]
    bodies: Vec<String>,
    #[pyo3(get)]
    device: String,
}

impl Simulation {
    /// Waits for the state; on the thread that waits for the simulation's own haptic loop this is an error.
    fn lock(&self) -> palpate::Result<MutexGuard<'_, State>> {
        if *self.holder.lock().unwrap_or_else(PoisonError::into_inner) == Some(thread::current().id()) {
            let problem = "the simulation is in its haptic loop";
            return Err(palpate::Error::Usage(format!("{problem}; call it when `hold` has returned")));
        }
        Ok(self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Calls `work` without the interpreter's lock.
    fn with<T: Send>(&self, py: Python<'_>, work: impl Send + FnOnce(&mut State) -> palpate::Result<T>) -> PyResult<T> {
        py.detach(|| work(&mut *self.lock()?)).map_err(raise)
    }

    /// What `of` reads of the simulation, without the interpreter's lock.
    fn read<T: Send>(&self, py: Python<'_>, of: impl Send + FnOnce(&palpate::Simulation) -> T) -> PyResult<T> {
        self.with(py, |state| Ok(of(&state.simulation)))
    }
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (scene, context, device, threads, cache))]
    fn new(
        py: Python<'_>,
        scene: &Scene,
        context: Option<&Context>,
        device: Option<String>,
        threads: Option<&str>,
        cache: bool,
    ) -> PyResult<Simulation> {
        let options = options(device, threads, cache, None)?;
        let opened = py.detach(|| match context {
            Some(context) => palpate::Simulation::on_device(&context.inner, &scene.inner),
            None => {
                let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
                palpate::Simulation::open(&scene.inner, &options)
            }
        });
        let mut simulation = opened.map_err(raise)?;
        simulation.time_every(0).map_err(raise)?;
        let bodies = simulation.scene().bodies.iter().map(|body| body.name.clone()).collect();
        let device = simulation.context().device_name().to_string();
        let state = Mutex::new(State { simulation, skins: None, studio: None });
        Ok(Simulation { state, holder: Mutex::new(None), bodies, device })
    }

    /// Simulates a step; the haptic device moves to `target`, or follows the scene's keys.
    fn step(&self, py: Python<'_>, target: Option<PlainPose>) -> PyResult<PlainReport> {
        let target = target.map(pose).transpose()?;
        self.with(py, |State { simulation, .. }| {
            let report = match target {
                Some(target) => simulation.step_at(target),
                None => simulation.step(),
            }?;
            Ok(plain_report(&report, simulation.reaction_names()))
        })
    }

    /// Simulates a step; the haptic device of each tool moves to one of `targets`.
    fn step_tools(&self, py: Python<'_>, targets: Vec<PlainPose>) -> PyResult<PlainReport> {
        let targets = targets.into_iter().map(pose).collect::<PyResult<Vec<Pose>>>()?;
        self.with(py, |State { simulation, .. }| {
            let report = simulation.step_at_poses(&targets)?;
            Ok(plain_report(&report, simulation.reaction_names()))
        })
    }

    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, palpate::Simulation::time)
    }

    /// Runs the haptic loop; returns ticks, steps, pace, greatest force, why it ended early, notes, and the rest as JSON.
    #[pyo3(signature = (seconds, device, every, watch))]
    fn hold(
        &self,
        py: Python<'_>,
        seconds: f64,
        device: Option<String>,
        every: f64,
        watch: Option<Py<PyAny>>,
    ) -> PyResult<Vec<PlainSession>> {
        let reports = py.detach(|| {
            let mut state = self.lock().map_err(raise)?;
            let _held = Held::by_this_thread(&self.holder);
            hold(&mut state.simulation, device.as_deref(), seconds, every, watch.as_ref())
        })?;
        let plain = |report: Report| {
            let all = palpate_cli::session_summary(&report).to_string();
            let ticks = report.lateness.ticks();
            (report.tool, ticks, report.steps, report.pace, report.peak_force, report.ended, report.notes, all)
        };
        Ok(reports.into_iter().map(plain).collect())
    }

    /// Notes on values that are most likely a mistake, and on what preparation changed in the bodies' mesh files.
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.read(py, palpate::Simulation::notes)
    }

    fn contacts<'py>(&self, py: Python<'py>) -> PyResult<PlainContacts<'py>> {
        let contacts = self.with(py, |state| state.simulation.contacts())?;
        let vectors = |of: fn(&ContactPoint) -> DVec3| points(py, contacts.iter().map(of).collect());
        let scalars = |of: fn(&ContactPoint) -> f64| numbers(py, contacts.iter().map(of));
        let bodies: Vec<[u32; 2]> = contacts.iter().map(|contact| contact.bodies.map(|body| body as u32)).collect();
        let vertices: Vec<u32> = contacts.iter().map(|contact| contact.vertex as u32).collect();
        Ok((
            rows(py, &bodies)?,
            vertices.into_pyarray(py),
            vectors(|contact| contact.position)?,
            vectors(|contact| contact.normal)?,
            scalars(|contact| contact.depth),
            scalars(|contact| contact.area),
            scalars(|contact| contact.pressure),
            vectors(|contact| contact.friction)?,
        ))
    }

    /// World positions and velocities of the nodes of a soft body; empty for another body.
    fn nodes<'py>(&self, py: Python<'py>, body: usize) -> PyResult<(Points<'py>, Points<'py>)> {
        let (positions, velocities) = self.with(py, |state| {
            let velocities = state.simulation.nodes(body)?.map_or(Vec::new(), |(_, velocities)| velocities);
            Ok((state.simulation.node_positions(body)?, velocities))
        })?;
        Ok((points(py, positions)?, points(py, velocities)?))
    }

    /// Cauchy's stress in each tetrahedron of a soft body; empty for another body.
    fn stress<'py>(&self, py: Python<'py>, body: usize) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let all = self.with(py, |state| state.simulation.stresses(body))?;
        let numbers: Vec<f64> = all.iter().flat_map(|stress| stress.to_cols_array()).collect();
        numbers.into_pyarray(py).reshape([all.len(), 3, 3])
    }

    /// Strain energy density in each tetrahedron of a soft body; empty for another body.
    fn strain_energy_density<'py>(&self, py: Python<'py>, body: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.with(py, |state| state.simulation.strain_energy_densities(body))?.into_pyarray(py))
    }

    /// Contact force on each vertex of a body's skin.
    fn contact_forces<'py>(&self, py: Python<'py>, body: usize) -> PyResult<Points<'py>> {
        points(py, self.with(py, |state| state.simulation.contact_forces(body))?)
    }

    /// Nodes of each tetrahedron of a soft body; empty for another body.
    fn tetrahedra<'py>(&self, py: Python<'py>, body: usize) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let tetrahedra = self.read(py, |simulation| match simulation.bodies().get(body).map(|body| &body.shape) {
            Some(Shape::Soft { layer, .. }) => layer.tetrahedra.clone(),
            _ => Vec::new(),
        })?;
        rows(py, &tetrahedra)
    }

    /// Views of the world positions and the normals of a skin's vertices, four float32 a vertex; the next call changes
    /// what earlier views show.
    fn skin<'py>(&self, py: Python<'py>, body: usize) -> PyResult<[Bound<'py, PyArray2<f32>>; 2]> {
        let (arrays, range) = self.with(py, |State { simulation, skins, .. }| {
            let arrays = SkinCopies::refresh(skins, simulation)?;
            Ok((arrays, simulation.skin_ranges().get(body).cloned().unwrap_or(0..0)))
        })?;
        let [positions, normals] = &arrays;
        Ok([view(py, positions, range.clone())?, view(py, normals, range)?])
    }

    fn triangles<'py>(&self, py: Python<'py>, body: usize) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let triangles = self.read(py, |simulation| simulation.skin_triangles(body).to_vec())?;
        rows(py, &triangles)
    }

    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.with(py, |state| state.simulation.save())?))
    }

    fn restore(&self, py: Python<'_>, state: &[u8]) -> PyResult<()> {
        self.with(py, |own| own.simulation.restore(state))
    }

    /// Young's modulus, Poisson's ratio, density and both damping coefficients of each material of a body.
    fn materials(&self, py: Python<'_>, body: usize) -> PyResult<Vec<[f64; 5]>> {
        let plain = |m: &Material| [m.young, m.poisson, m.density, m.damping_mass, m.damping_stiffness];
        self.read(py, |simulation| simulation.materials(body).iter().map(plain).collect())
    }

    fn set_material(&self, py: Python<'_>, body: usize, index: usize, values: [f64; 5]) -> PyResult<()> {
        let [young, poisson, density, damping_mass, damping_stiffness] = values;
        self.with(py, |state| {
            let materials = state.simulation.materials(body);
            let law = materials.get(index).map_or(Material::new(1.0, 0.0, 1.0).law, |material| material.law);
            let material = Material { law, young, poisson, density, damping_mass, damping_stiffness };
            state.simulation.set_material(body, index, material)
        })
    }

    /// Sets stiffness, damping and friction of contact; None keeps a value.
    fn set_contact(
        &self,
        py: Python<'_>,
        stiffness: Option<f64>,
        damping: Option<f64>,
        friction: Option<f64>,
        depth_limit: Option<f64>,
    ) -> PyResult<()> {
        self.with(py, |state| {
            let mut law = state.simulation.scene().contact.clone();
            law.stiffness = stiffness.or(law.stiffness);
            law.damping = damping.or(law.damping);
            law.friction = friction.unwrap_or(law.friction);
            law.depth_limit = depth_limit.unwrap_or(law.depth_limit);
            state.simulation.set_contact(&law)
        })
    }

    /// Sets stiffness, damping, angular stiffness and angular damping of the virtual coupling; None removes it.
    fn set_coupling(&self, py: Python<'_>, values: Option<[f64; 4]>) -> PyResult<()> {
        let coupling = values.map(|[stiffness, damping, angular_stiffness, angular_damping]| Coupling {
            stiffness,
            damping,
            angular_stiffness,
            angular_damping,
        });
        self.with(py, |state| state.simulation.set_coupling(coupling))
    }

    fn core_pose(&self, py: Python<'_>, body: usize, core: usize) -> PyResult<Option<PlainPose>> {
        self.read(py, |simulation| simulation.core_pose(body, core).as_ref().map(plain))
    }

    fn move_core(&self, py: Python<'_>, body: usize, core: usize, target: PlainPose, seconds: f64) -> PyResult<()> {
        let target: Pose = pose(target)?;
        let time = Duration::try_from_secs_f64(seconds).map_err(|_| wrong("seconds must be zero or more"))?;
        self.with(py, |state| state.simulation.move_core(body, core, target, time))
    }

    /// An image of the simulation as it is now, which options like those of `palpate film` describe: rows of pixels of
    /// three bytes.
    fn picture<'py>(&self, py: Python<'py>, options: Vec<String>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let picture = self.with(py, |State { simulation, studio, .. }| {
            let look = Look::parse(&options)?;
            let mut current = match studio.take() {
                Some((of, studio)) if of == look => studio,
                _ => look.studio(simulation)?,
            };
            let picture = current.picture(simulation)?;
            *studio = Some((look, current));
            Ok(picture)
        })?;
        let [height, width] = [picture.height, picture.width].map(|side| side as usize);
        picture.rgb().into_pyarray(py).reshape([height, width, 3])
    }
}

fn plain_report<'a>(report: &StepReport, names: impl Iterator<Item = &'a str>) -> PlainReport {
    let tool =
        |tool: &ToolReport| (tool.force.to_array(), tool.torque.to_array(), plain(&tool.tool), plain(&tool.device));
    let work = &report.work;
    (
        report.step,
        report.time,
        report.tools().map(tool).collect(),
        report.contacts,
        report.max_depth,
        report.iterations,
        report.residual,
        report.flags.0,
        report.step_us,
        report.probes.iter().map(|probe| probe.to_array()).collect(),
        names.zip(&report.reactions).map(|(name, w)| (name.into(), w.force.to_array(), w.torque.to_array())).collect(),
        (work.solves, work.submits, work.planned_iterations, work.dependent_passes),
    )
}
