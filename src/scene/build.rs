//! [`SceneBuilder`] makes a scene (the bodies, the tool and the settings of a simulation) piece by piece: from Rust
//! values, from TOML tables in the format of scene files, and from meshes in memory. The reader of scene files
//! (`load.rs`) uses it too; `check.rs` has the rules for values. A soft body has a skin (surface mesh), a layer
//! (tetrahedral mesh) and cores (rigid bodies inside it, to which nodes of the layer are attached). The tool is the
//! rigid body that the haptic device moves. A *key* is the name of a value in a scene file, such as `step.dt`; the key
//! of a trajectory is a pose at a given time.

use std::path::PathBuf;

use glam::DQuat;

use super::check::{self, Check, Problem};
use super::keys::{Node, Source};
use super::load::TOOL;
use super::meshes::Meshes;
use super::names::Unresolved;
use super::{
    Body, Contact, Core, Coupling, FurtherTool, Haptics, Key, Motion, Probe, Scene, Solver, Step, Tool, load, names,
};
use crate::{Error, Result};

/// A scene under construction. Each method checks the values that it is given. If a value is invalid, the error names
/// the key of that value in a scene file, and the scene stays unchanged. [`SceneBuilder::build`] checks that all bodies
/// exist to which the scene refers by name.
///
/// ```
/// use palpate::SceneBuilder;
/// use palpate::scene::{Bind, Body, Core, Coupling, Key, Material, Tool};
///
/// # fn main() -> palpate::Result<()> {
/// let gel = Material::new(2e4, 0.45, 1000.0);
/// let mut block = Body::block("block", [0.0, 0.0, 0.0], [0.06, 0.03, 0.06], [8, 4, 8], gel);
/// block.cores.push(Core::fixed("table", Bind::Box { low: [-1.0, -1.0, -1.0].into(), high: [1.0, 1e-3, 1.0].into() }));
/// let scene = SceneBuilder::new("press")
///     .body(block)?
///     .tool(Tool::sphere(0.01, 0.05).at([0.03, 0.045, 0.03]))?
///     .coupling(Coupling { stiffness: 500.0, damping: 5.0, ..Coupling::default() })?
///     .trajectory(vec![Key::at(0.0, [0.03, 0.045, 0.03]), Key::at(0.2, [0.03, 0.035, 0.03])])?
///     .build()?;
/// assert_eq!(scene.bodies[0].name, "block");
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct SceneBuilder {
    scene: Scene,
    meshes: Meshes,
}

impl SceneBuilder {
    /// A scene without bodies and tool, with the settings that an empty scene file gives. Error messages and results
    /// show `name` as the scene's file. Paths in tables are relative to the folder of `name`; paths in
    /// [`super::Surface::File`] and [`super::Layer::File`] are relative to the working directory.
    pub fn new(name: impl Into<PathBuf>) -> SceneBuilder {
        SceneBuilder { scene: Scene::empty(name), meshes: Meshes::default() }
    }

    /// Starts from an existing scene.
    pub fn of(scene: Scene) -> SceneBuilder {
        SceneBuilder { scene, meshes: Meshes::default() }
    }

    /// Sets time step, gravity and number of Newton iterations.
    ///
    /// # Errors
    /// `step` has a value that is not allowed in a scene file. The methods below fail for such values too.
    pub fn step(&mut self, step: Step) -> Result<&mut Self> {
        step.check().map_err(|problem| self.wrong("step", problem))?;
        self.overrule(&["step.dt", "step.newton"]);
        self.scene.step = step;
        Ok(self)
    }

    /// Sets tolerance, greatest number of iterations, preconditioner and operator of the linear solver.
    pub fn solver(&mut self, solver: Solver) -> Result<&mut Self> {
        solver.check().map_err(|problem| self.wrong("solver", problem))?;
        self.overrule(&["solver.tolerance", "solver.max_iterations"]);
        self.scene.solver = solver;
        Ok(self)
    }

    /// Sets stiffness, damping, friction and the other settings of contact.
    pub fn contact(&mut self, contact: Contact) -> Result<&mut Self> {
        contact.check().map_err(|problem| self.wrong("contact", problem))?;
        self.overrule(&["contact.sides"]);
        self.scene.contact = contact;
        Ok(self)
    }

    /// Adds a body. Its name must not be that of another body, nor "tool".
    pub fn body(&mut self, body: Body) -> Result<&mut Self> {
        let key = format!("body.{}", body.name);
        let cores = body.cores.into_iter().map(|core| match core.motion {
            Motion::Kinematic(keys) => Core { motion: Motion::Kinematic(unit_keys(keys)), ..core },
            _ => core,
        });
        let (cores, orientation) = (cores.collect(), unit(body.orientation));
        let body = Body { cores, orientation, ..body };
        self.put_body(body).map_err(|problem| self.wrong(&key, problem))?;
        Ok(self)
    }

    /// Sets the tool, which the haptic device moves; earlier tools of the scene, further ones too, are replaced.
    pub fn tool(&mut self, tool: Tool) -> Result<&mut Self> {
        tool.check().map_err(|problem| self.wrong("tool", problem))?;
        self.scene.tool = Some(Tool { orientation: unit(tool.orientation), ..tool });
        self.scene.drop_further_tools();
        Ok(self)
    }

    /// Adds a tool after the first, for another haptic device. In a scene with several tools each is a body of the scene
    /// ([`Tool::body`]); there are four at most.
    pub fn further_tool(&mut self, tool: FurtherTool) -> Result<&mut Self> {
        let key = format!("tool.{}", tool.name);
        let check = tool.check(self.scene.tool.as_ref(), &self.scene.further_tools);
        check.map_err(|problem| self.wrong(&key, problem))?;
        let trajectory = unit_keys(tool.trajectory);
        let haptics = tool.haptics.map(Haptics::for_device);
        self.scene.further_tools.push(FurtherTool { trajectory, haptics, ..tool });
        self.scene.haptics.has_device |= self.scene.has_further_device();
        Ok(self)
    }

    /// Sets the virtual coupling between haptic device and tool; of several tools the first.
    pub fn coupling(&mut self, coupling: Coupling) -> Result<&mut Self> {
        coupling.check().map_err(|problem| self.wrong("coupling", problem))?;
        self.scene.coupling = Some(coupling);
        Ok(self)
    }

    /// Sets the reference trajectory of the haptic device (of several the first): poses at given times, interpolated in
    /// between.
    pub fn trajectory(&mut self, keys: Vec<Key>) -> Result<&mut Self> {
        check::keys(&keys).map_err(|problem| self.wrong("drive.keys", problem))?;
        self.scene.trajectory = unit_keys(keys);
        Ok(self)
    }

    /// Sets the haptic device and the settings of the haptic loop. The value of [`Haptics::has_device`] in `haptics` is
    /// not used: it is computed from the kinds of the devices of all tools.
    pub fn haptics(&mut self, haptics: Haptics) -> Result<&mut Self> {
        haptics.check().map_err(|problem| self.wrong("haptics", problem))?;
        self.scene.haptics = haptics.for_device();
        self.scene.haptics.has_device |= self.scene.has_further_device();
        Ok(self)
    }

    /// Adds a probe: a vertex of a body's skin (surface mesh) whose position is recorded.
    pub fn probe(&mut self, probe: Probe) -> Result<&mut Self> {
        let key = format!("probe.{}", probe.name);
        probe.check(&self.scene.probes).map_err(|problem| self.wrong(&key, problem))?;
        self.scene.probes.push(probe);
        Ok(self)
    }

    /// Adds the tables of `text`, which has the format of scene files. Bodies and probes of the text come after those
    /// of the scene. A key of `[step]`, `[solver]` or `[contact]` replaces one value of the scene; any other table
    /// replaces the scene's whole table. Every body to which the text refers must be in the text or in the scene.
    pub fn toml(&mut self, text: &str) -> Result<&mut Self> {
        let document = self.source(text).parse()?;
        self.add_document(text, &document)?;
        Ok(self)
    }

    /// Checks the scene as a whole and returns it.
    ///
    /// # Errors
    /// The scene has neither a body nor a tool; a body, a probe or the tool refers to a body or tool that does not
    /// exist; the scene has a coupling or a trajectory but no tool; or the scene that [`SceneBuilder::of`] was given
    /// has an invalid value.
    pub fn build(&self) -> Result<Scene> {
        let scene = &self.scene;
        scene.check_filled()?;
        let of = |key: &str, check: Check| check.map_err(|problem| self.wrong(key, problem));
        of("step", scene.step.check())?;
        of("solver", scene.solver.check())?;
        of("contact", scene.contact.check())?;
        scene.bodies.iter().try_for_each(|body| of(&format!("body.{}", body.name), body.check()))?;
        of("tool", scene.tool.as_ref().map_or(Ok(()), Tool::check))?;
        of("coupling", scene.coupling.as_ref().map_or(Ok(()), Coupling::check))?;
        for (index, tool) in scene.further_tools.iter().enumerate() {
            let check = tool.check(scene.tool.as_ref(), &scene.further_tools[..index]);
            of(&format!("tool.{}", tool.name), check)?;
        }
        if !scene.further_tools.is_empty() && (scene.rigid_tool().is_some() || scene.tool.is_none()) {
            let problem = "is not a body of the scene, but there are several tools";
            return Err(Error::key(&scene.file, "tool", problem, "make each of several tools a body of the scene"));
        }
        of("haptics", scene.haptics.check())?;
        for (key, is_given) in [("coupling", scene.coupling.is_some()), ("drive", !scene.trajectory.is_empty())] {
            if is_given && scene.tool.is_none() {
                return Err(Error::key(&scene.file, key, "needs a tool in the scene", "add one or leave the key out"));
            }
        }
        let check = names::resolve(scene, [0, 0], true);
        check.map_err(|Unresolved { place, problem, remedy }| {
            Error::key(&scene.file, place.key(scene), problem, remedy)
        })?;
        Ok(scene.clone())
    }

    /// The scene as built so far; it may refer to bodies that are not added yet.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The meshes in memory of this builder; tables that are added later refer to them by name.
    #[doc(hidden)]
    pub fn meshes(&mut self) -> &mut Meshes {
        &mut self.meshes
    }

    /// Does what [`SceneBuilder::toml`] does, for tables that a program made. As there is no text, errors name keys but
    /// no lines.
    #[doc(hidden)]
    pub fn tables(&mut self, tables: &toml::Table) -> Result<()> {
        self.add_document("", &Node::from(tables))
    }

    /// Removes the scene's tool and virtual coupling, if it has them, and then adds `tables`, which a program made and
    /// which may have a new tool and a new coupling.
    #[doc(hidden)]
    pub fn replace_tool(&mut self, tables: &toml::Table) -> Result<()> {
        let mut next = self.clone();
        (next.scene.tool, next.scene.coupling) = (None, None);
        next.scene.drop_further_tools();
        next.tables(tables)?;
        *self = next;
        Ok(())
    }

    /// Sets the bodies with which the body of index `body` collides: the existing bodies called `names`, or all other
    /// bodies where `names` is `None`.
    pub fn collides(&mut self, body: usize, names: Option<Vec<String>>) -> Result<&mut Self> {
        let bodies = self.scene.bodies.len();
        let Some(named) = self.scene.bodies.get(body) else {
            let problem = format!("is {body}; the scene has {bodies} bodies, counted from 0");
            return Err(Error::key(&self.scene.file, "body", problem, "give the index of a body"));
        };
        for name in names.iter().flatten() {
            names::check_partner(&self.scene, named, name).map_err(|(problem, remedy)| {
                Error::key(&self.scene.file, format!("body.{}.collides", named.name), problem, remedy)
            })?;
        }
        self.scene.bodies[body].collides = names;
        Ok(self)
    }

    /// Checks a body and adds it. If the check finds a problem, the key in that problem is relative to the table of the
    /// body in a scene file.
    pub(super) fn put_body(&mut self, body: Body) -> Check {
        if body.name == TOOL || self.scene.bodies.iter().any(|other| other.name == body.name) {
            let problem = format!("\"{}\" is taken", body.name);
            return Err(Problem::of("name", problem, "names of bodies are unique, and \"tool\" means the tool"));
        }
        body.check()?;
        let others: Vec<String> = self.scene.bodies.iter().flat_map(Body::reaction_names).collect();
        if let Some(name) = body.reaction_names().find(|name| others.contains(name)) {
            let problem = format!("\"{name}\" would be the name of two reactions");
            return Err(Problem::of("name", problem, "choose names of bodies, cores or supports without '.'"));
        }
        self.scene.bodies.push(body);
        Ok(())
    }

    /// The scene as built so far; `load.rs` changes it.
    pub(super) fn scene_mut(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// Removes `keys` from the list of settings whose values come from the scene's preset (a named set of settings).
    fn overrule(&mut self, keys: &[&str]) {
        if let Some(preset) = &mut self.scene.preset {
            preset.set.retain(|(key, _)| !keys.contains(key));
        }
    }

    fn source<'a>(&'a self, text: &'a str) -> Source<'a> {
        Source { file: &self.scene.file, text, meshes: &self.meshes }
    }

    fn add_document(&mut self, text: &str, document: &Node) -> Result<()> {
        let mut next = self.clone();
        load::add(&mut next, &self.source(text), document)?;
        *self = next;
        Ok(())
    }

    fn wrong(&self, key: &str, problem: Problem) -> Error {
        let Problem { key, problem, remedy } = problem.within(key);
        Error::key(&self.scene.file, key, problem, remedy)
    }
}

/// The normalised quaternion, or `orientation` unchanged if its length differs from one by more than rounding.
fn unit(orientation: DQuat) -> DQuat {
    check::unit_quaternion(orientation.to_array()).unwrap_or(orientation)
}

fn unit_keys(keys: Vec<Key>) -> Vec<Key> {
    keys.into_iter().map(|key| Key { orientation: unit(key.orientation), ..key }).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::scene::{
        Bind, Dilatation, Joint, Layer, Material, Model, Place, Region, Resistance, Shape, Surface, ToolShape,
    };

    const BLOCK: &str = "layer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
                         material = { young = 1e4, poisson = 0.3, density = 1000 }\n";
    const TOOL: &str = "[tool]\nsphere = 0.01\nmass = 0.1\n";

    fn block(name: &str, more: &str) -> String {
        format!("[[body]]\nname = \"{name}\"\n{BLOCK}{more}\n")
    }

    fn refused(builder: &mut SceneBuilder, text: &str, words: &str) {
        let before = format!("{:?}", builder.scene());
        let error = builder.toml(text).unwrap_err().to_string();
        assert!(error.contains(words), "unexpected error: {error}");
        assert_eq!(format!("{:?}", builder.scene()), before);
    }

    #[test]
    fn what_a_text_leaves_out_stays() {
        let mut builder = SceneBuilder::new("s");
        builder.toml("[step]\ndt = 0.004\n[contact]\nfriction = 0.3\n[solver]\npreconditioner = \"jacobi\"").unwrap();
        builder.toml(&format!("{TOOL}[coupling]\nstiffness = 10\ndamping = 1\n[haptics]\ntrust = 0.5")).unwrap();
        builder.toml("[step]\nnewton = 3\n[contact]\nstiffness = 1e6").unwrap();
        builder.toml(&block("a", "")).unwrap();
        builder.toml(&block("b", "collides = [\"a\", \"tool\"]")).unwrap();
        let scene = builder.scene();
        assert_eq!((scene.step.dt, scene.step.newton, scene.contact.friction), (0.004, 3, 0.3));
        assert_eq!((scene.contact.stiffness, scene.haptics.trust), (Some(1e6), 0.5));
        assert!(scene.coupling.is_some() && scene.bodies.len() == 2);
        builder.toml("preset = \"fast\"\n[step]\nnewton = 2").unwrap();
        let scene = builder.scene();
        assert_eq!((scene.step.dt, scene.step.newton, scene.contact.friction), (0.008, 2, 0.3));
        let other: toml::Table = "[tool]\nsphere = 0.02\nmass = 0.2".parse().unwrap();
        builder.replace_tool(&other).unwrap();
        assert!(builder.scene().coupling.is_none());
        assert!(matches!(builder.scene().tool.as_ref().unwrap().shape, ToolShape::Sphere(0.02)));
    }

    #[test]
    fn what_a_text_names_is_there_already_and_an_error_changes_nothing() {
        let mut builder = SceneBuilder::new("s");
        refused(&mut builder, &block("b", "collides = [\"a\"]"), "there is no body \"a\"");
        refused(&mut builder, "[coupling]\nstiffness = 1\ndamping = 1", "there is no [tool]");
        builder.toml(&(block("a", "") + TOOL)).unwrap();
        refused(&mut builder, &(block("b", "") + &block("a", "")), "s:7: `body[1].name`: \"a\" is taken");
        let probe = "[[probe]]\nname = \"p\"\nbody = \"a\"\nnearest = [0, 0, 0]\n";
        refused(&mut builder, &(block("b", "") + probe + probe), "taken by another probe");
        builder.toml(probe).unwrap();
        refused(&mut builder, probe, "taken by another probe");
        refused(&mut builder, "[[probe]]\nname = \"q\"\nbody = \"b\"\nnearest = [0, 0, 0]", "there is no body \"b\"");
        builder
            .toml(&block(
                "b",
                "collides = [\"tool\"]\n[[body.core]]\nname = \"c\"\nmotion = \"dynamic\"\nbind = { all = true }",
            ))
            .unwrap();
        refused(&mut builder, "[tool]\nbody = \"b\"", "body \"b\" names \"tool\" in `collides`");
        builder.collides(0, Some(vec!["b".into(), "tool".into()])).unwrap();
        assert_eq!(builder.scene().bodies[0].collides, Some(vec!["b".into(), "tool".into()]));
        for (body, name, words) in
            [(0, "a", "names the body itself"), (1, "c", "no body \"c\""), (2, "a", "`body`: is 2")]
        {
            let error = builder.collides(body, Some(vec![name.into()])).unwrap_err().to_string();
            assert!(error.contains(words), "unexpected error: {error}");
        }
        builder.collides(1, None).unwrap();
        builder.toml("[tool]\nbody = \"b\"").unwrap_err();
        builder.collides(0, None).unwrap();
        builder.toml("[tool]\nbody = \"b\"").unwrap();
        assert!(builder.collides(0, Some(vec!["tool".into()])).unwrap_err().to_string().contains("which is a body"));
    }

    #[test]
    fn meshes_are_found_by_name() {
        let mut builder = SceneBuilder::new("s");
        let corner = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        builder.meshes().add_surface("skin", corner.clone(), &faces).unwrap();
        builder.meshes().add_layer("inside", corner, &[[0, 2, 1, 3]]).unwrap();
        let soft = "material = { young = 1e4, poisson = 0.3, density = 1000 }\nrepair = false";
        let body = |surface: &str, layer: &str| {
            format!(
                "[[body]]\nname = \"a\"\nsurface = {{ mesh = \"{surface}\" }}\nlayer = {{ mesh = \"{layer}\" }}\n{soft}"
            )
        };
        refused(
            &mut builder,
            &body("inside", "inside"),
            "s:3: `body.a.surface.mesh`: there is no mesh \"inside\" in memory",
        );
        refused(&mut builder, &body("skin", "skin"), "s:4: `body.a.layer.mesh`: there is no mesh \"skin\" in memory");
        refused(&mut builder, &body("skin", "inside\", cell = \"1"), "unknown key `body.a.layer.cell`");
        builder.toml(&body("skin", "inside")).unwrap();
        builder.toml("[tool]\nsurface = { mesh = \"skin\" }\nmass = 1").unwrap();
        let Shape::Soft { surface: Some(Surface::Mesh(skin)), layer: Layer::Mesh(inside) } =
            &builder.scene().bodies[0].shape
        else {
            panic!("the skin and the layer are not meshes in memory: {:?}", builder.scene().bodies[0]);
        };
        // The tetrahedron was given with negative volume; its nodes were reordered, as for one from a file.
        assert_eq!((skin.triangles.len(), inside.tetrahedra[0]), (4, [0, 2, 3, 1]));
    }

    #[test]
    fn numbers_of_tables_arrive_with_all_their_bits() {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            Some(f64::from_bits(state)).filter(|x| x.abs() <= 1e30).unwrap_or(0.1 + 0.2)
        };
        for _ in 0..300 {
            let point: [f64; 3] = std::array::from_fn(|_| random());
            let mut tables: toml::Table = format!("[[body]]\nname = \"a\"\n{BLOCK}").parse().unwrap();
            tables["body"][0].as_table_mut().unwrap().insert("position".into(), point.to_vec().into());
            let mut builder = SceneBuilder::new("s");
            builder.tables(&tables).unwrap();
            let read = builder.scene().bodies[0].position.to_array();
            assert_eq!(read.map(f64::to_bits), point.map(f64::to_bits));
        }
    }

    fn soft() -> Body {
        let mut body = Body::block("a", [0.0; 3], [1.0; 3], [1; 3], Material::new(1e4, 0.3, 1e3));
        body.cores.push(Core::fixed("c", Bind::All));
        body
    }

    /// The message of a builder's error, without the scene's name at its beginning.
    fn words(result: Result<&mut SceneBuilder>) -> String {
        let error = result.map(|_| ()).unwrap_err().to_string();
        error.strip_prefix("s: ").unwrap().into()
    }

    #[test]
    fn what_is_wrong_with_a_body_is_told_by_the_key_of_a_scene_file() {
        type Spoil = fn(&mut Body);
        let cases: [(Spoil, &str); 26] = [
            (|b| b.name = "a b".into(), "`body.a b.name`: \"a b\" cannot be a name; "),
            (|b| b.name = "tool".into(), "`body.tool.name`: \"tool\" is taken; "),
            (|b| b.material = None, "`body.a.material`: missing; a soft body"),
            (
                |b| b.material = Some(Material::new(f64::NAN, 0.3, 1e3)),
                "`body.a.material.young`: is NaN; give a finite",
            ),
            (
                |b| b.material = Some(Material::new(-1.0, 0.3, 1e3)),
                "`body.a.material.young`: is -1.0; give a number gr",
            ),
            (|b| b.material = Some(Material::new(1e4, 0.5, 1e3)), "`body.a.material.poisson`: is 0.5; give a number f"),
            (|b| b.scale = 0.0, "`body.a.scale`: is 0.0; give a number greater than zero, 1e-30 at least"),
            (|b| b.position.y = f64::INFINITY, "`body.a.position[1]`: is inf; give a finite number"),
            (|b| b.orientation = DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), "`body.a.orientation`: quaternion has length 2"),
            (|b| b.hulls = Some(0), "`body.a.hulls`: is 0; give a whole number from 1 to 256"),
            (|b| b.cores[0].name = ".".into(), "`body.a.core...name`: \".\" cannot be a name"),
            (|b| b.cores[0].bind = None, "`body.a.core.c.bind`: missing"),
            (|b| b.cores[0].bind = Some(Bind::Nodes(vec![])), "`body.a.core.c.bind.nodes`: is empty"),
            (|b| b.cores[0].mass = Some(1.0), "`body.a.core.c.mass`: belongs to motion = \"dynamic\""),
            (
                |b| b.cores[0].motion = Motion::Kinematic(vec![]),
                "`body.a.core.c.keys`: is empty; give at least one key",
            ),
            (
                |b| b.cores[0].motion = Motion::Kinematic(vec![Key::at(1.0, [0.0; 3]), Key::at(0.5, [0.0; 3])]),
                "`body.a.core.c.keys[1]`: time 0.5 does not come after 1.0",
            ),
            (|b| b.cores.push(b.cores[0].clone()), "`body.a.core`: \"c\" is taken by another core"),
            (
                |b| {
                    let layer = Layer::Box { low: DVec3::ONE, high: DVec3::ZERO, cells: [1; 3] };
                    b.shape = Shape::Soft { surface: None, layer };
                },
                "`body.a.layer.box`: [1, 1, 1] is not below [0, 0, 0] on every axis",
            ),
            (
                |b| {
                    let layer = Layer::Box { low: DVec3::ZERO, high: DVec3::ONE, cells: [1, 0, 1] };
                    b.shape = Shape::Soft { surface: None, layer };
                },
                "`body.a.layer.cells[1]`: is 0; give a whole number from 1 to 1048576",
            ),
            (
                |b| {
                    let layer = Layer::Cell { cell: 0.1, grade: 3, thickness: None };
                    let surface = Surface::Model { model: Model::Head, vertices: 44_000 };
                    b.shape = Shape::Soft { surface: Some(surface), layer };
                },
                "`body.a.layer.grade`: is 3; give 1, 2, 4 or 8",
            ),
            (
                |b| {
                    let layer = Layer::Across { cells: 10, grade: 1, thickness: None };
                    b.shape = Shape::Soft { surface: None, layer };
                },
                "`body.a.surface`: missing; a layer of cells is made around a `surface`",
            ),
            (
                |b| {
                    let surface = Surface::Model { model: Model::Gear, vertices: 10 };
                    b.shape = Shape::Rigid { surface };
                },
                "`body.a.surface.vertices`: is 10; give a whole number from 2000 to 400000",
            ),
            (
                |b| b.shape = Shape::Rigid { surface: Surface::File("a.obj".into()) },
                "`body.a.material`: a rigid body has none",
            ),
            (
                |b| {
                    let surface = Surface::File("a.obj".into());
                    *b = Body::rigid("a", surface, Motion::Dynamic, None);
                },
                "`body.a.mass`: missing; a dynamic rigid body needs a mass",
            ),
            (|b| *b = Body::plane("a", [0.0; 3], 1.0), "`body.a.plane`: has a normal of length NaN"),
            (
                |b| {
                    let place = Place::Sphere { centre: DVec3::ZERO, radius: 0.0 };
                    b.regions.push(Region { place, material: Material::new(1e4, 0.3, 1e3) });
                },
                "`body.a.region[0].sphere`: has radius 0.0",
            ),
        ];
        for (spoil, want) in cases {
            let (mut body, mut builder) = (soft(), SceneBuilder::new("s"));
            spoil(&mut body);
            let said = words(builder.body(body));
            assert!(said.starts_with(want), "the error is: {said}\nit should begin with: {want}");
            assert!(builder.scene().bodies.is_empty());
        }
        let mut builder = SceneBuilder::new("s");
        builder.body(soft()).unwrap();
        assert!(words(builder.body(soft())).starts_with("`body.a.name`: \"a\" is taken"));
    }

    #[test]
    fn joints_of_a_body_are_of_its_own_cores_and_form_trees() {
        let joint = |cores| Joint { cores, point: DVec3::ZERO, resistance: Resistance::default() };
        let body = |joints: Vec<Joint>| {
            let cores = ["c", "d", "e"].map(|name| Core::dynamic(name, Bind::All));
            Body { joints, cores: cores.to_vec(), ..soft() }
        };
        let refused = |joints| words(SceneBuilder::new("s").body(body(joints)));
        assert!(refused(vec![joint([0, 3])]).starts_with("`body.a.joint[0].cores`: names core 3, but there are 3"));
        assert!(refused(vec![joint([1, 1])]).starts_with("`body.a.joint[0].cores`: is the same core"));
        let loop_of_three = vec![joint([0, 1]), joint([1, 2]), joint([2, 0])];
        assert!(refused(loop_of_three).starts_with("`body.a.joint[2]`: \"e\" and \"c\" are already connected"));
        let swing = Resistance { swing: Some(4.0), ..Resistance::default() };
        let said = refused(vec![Joint { resistance: swing, ..joint([0, 1]) }]);
        assert!(
            said.starts_with("`body.a.joint[0].swing`: is 4.0; give an angle below pi"),
            "unexpected error: {said}"
        );
        SceneBuilder::new("s").body(body(vec![joint([0, 1]), joint([1, 2])])).unwrap();
    }

    #[test]
    fn further_tools_are_checked_and_need_a_first_that_is_a_body() {
        let further = |name: &str| FurtherTool {
            name: name.into(),
            body: "a".into(),
            coupling: None,
            trajectory: vec![],
            haptics: None,
        };
        let mut builder = SceneBuilder::new("s");
        builder.body(soft()).unwrap().tool(Tool::sphere(0.1, 1.0)).unwrap().further_tool(further("b")).unwrap();
        let said = builder.build().unwrap_err().to_string();
        assert!(said.contains("`tool`: is not a body of the scene, but there are several tools"), "{said}");
        assert!(words(builder.further_tool(further("b"))).starts_with("`tool.b.name`: \"b\" is taken by another tool"));
        let weak = Coupling { stiffness: -1.0, ..Coupling::default() };
        let said = words(builder.further_tool(FurtherTool { coupling: Some(weak), ..further("c") }));
        assert!(said.starts_with("`tool.c.coupling.stiffness`: is -1.0"), "{said}");
        builder.further_tool(further("c")).unwrap().further_tool(further("d")).unwrap();
        assert!(words(builder.further_tool(further("e"))).starts_with("`tool.e`: is one tool too many"));
        assert!(builder.tool(Tool::sphere(0.1, 1.0)).unwrap().build().unwrap().further_tools.is_empty());
    }

    #[test]
    fn what_is_wrong_with_the_rest_is_told_likewise_and_changes_nothing() {
        let builder = || SceneBuilder::new("s");
        let said = [
            words(builder().step(Step { dt: 0.0, ..Step::default() })),
            words(builder().step(Step { newton: 0, ..Step::default() })),
            words(builder().solver(Solver { tolerance: Some(1.0), ..Solver::default() })),
            words(builder().contact(Contact { friction: -0.1, ..Contact::default() })),
            words(builder().contact(Contact { friction_speed: 0.0, ..Contact::default() })),
            words(builder().tool(Tool::sphere(0.0, 1.0))),
            words(builder().tool(Tool::sphere(0.1, 0.0))),
            words(builder().coupling(Coupling { stiffness: -1.0, ..Coupling::default() })),
            words(builder().trajectory(vec![])),
            words(builder().haptics(Haptics { rate: 1.0, ..Haptics::default() })),
            words(builder().probe(Probe { name: "tool".into(), body: "a".into(), nearest: DVec3::ZERO })),
        ];
        let want = [
            "`step.dt`: is 0.0; give a number greater than zero, 1e-30 at least",
            "`step.newton`: is 0; give a whole number from 1 to 100",
            "`solver.tolerance`: is 1.0; give a number below one",
            "`contact.friction`: is -0.1; give zero or a number greater than zero",
            "`contact.friction_speed`: is 0.0; give 1e-6 m/s or more: smaller values are lost in single precision",
            "`tool.sphere`: is 0.0; give a number greater than zero, 1e-30 at least",
            "`tool.mass`: is 0.0; give a number greater than zero, 1e-30 at least",
            "`coupling.stiffness`: is -1.0; give zero or a number greater than zero",
            "`drive.keys`: is empty; give at least one key",
            "`haptics.rate`: is 1.0; give 50.0 to 4000.0 Hz",
            "`probe.tool.name`: \"tool\" is a column of the trace already; choose another name",
        ];
        assert_eq!(said, want);
        let mut all = builder();
        assert!(all.build().unwrap_err().to_string().contains("neither a body nor a tool"));
        all.body(Body { collides: Some(vec!["b".into()]), ..soft() }).unwrap();
        assert!(all.build().unwrap_err().to_string().contains("`body.a.collides`: there is no body \"b\""));
        all.body(Body { name: "b".into(), dilatation: Dilatation::Patch, ..soft() }).unwrap();
        all.trajectory(vec![Key::at(0.0, [0.0; 3])]).unwrap();
        assert!(all.build().unwrap_err().to_string().contains("`drive`: needs a tool in the scene"));
        all.tool(Tool::body("b")).unwrap();
        assert!(all.build().unwrap_err().to_string().contains("`tool.body`: the first core of \"b\""));
        all.tool(Tool::sphere(0.1, 1.0)).unwrap();
        all.probe(Probe { name: "p".into(), body: "c".into(), nearest: DVec3::ZERO }).unwrap();
        assert!(all.build().unwrap_err().to_string().contains("`probe.p.body`: there is no body \"c\""));
    }

    #[test]
    fn values_and_tables_make_the_same_scene() {
        let text = "[step]\ndt = 0.002\n[contact]\nfriction = 0.3\n[[body]]\nname = \"a\"\n\
                    layer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
                    material = { young = 1e4, poisson = 0.3, density = 1e3 }\n\
                    [[body.core]]\nname = \"c\"\nbind = { all = true }\n\
                    [tool]\nsphere = 0.01\nmass = 0.1\nposition = [1, 2, 3]\n\
                    [coupling]\nstiffness = 5\ndamping = 1\n[drive]\nkeys = [[0, 1, 2, 3]]\n";
        let written = Scene::parse("s".as_ref(), text).unwrap();
        let mut builder = SceneBuilder::new("s");
        builder.step(Step { dt: 0.002, ..Step::default() }).unwrap();
        builder.contact(Contact { friction: 0.3, ..Contact::default() }).unwrap();
        builder.body(soft()).unwrap().tool(Tool::sphere(0.01, 0.1).at([1.0, 2.0, 3.0])).unwrap();
        builder.coupling(Coupling { stiffness: 5.0, damping: 1.0, ..Coupling::default() }).unwrap();
        builder.trajectory(vec![Key::at(0.0, [1.0, 2.0, 3.0])]).unwrap();
        assert_eq!(format!("{:?}", builder.build().unwrap()), format!("{written:?}"));
    }
}
