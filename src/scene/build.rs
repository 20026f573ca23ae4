//! [`Builder`]: a scene made piece by piece, of the tables of scene files and of meshes in memory.
//!
//! There is one reader of tables and one set of checks, those of `load.rs`, whether a table was written by a person or
//! made by a program.

use std::path::PathBuf;

use super::keys::Source;
use super::load;
use super::meshes::Meshes;
use super::{Scene, names};
use crate::{Error, Result};

/// A scene in the making. It is sound after each call: what a call names (a body, the tool, a mesh) is there already.
#[derive(Debug, Clone)]
pub struct Builder {
    scene: Scene,
    meshes: Meshes,
}

impl Builder {
    /// Begins with a scene; `Scene::empty` for one of nothing.
    pub fn new(scene: Scene) -> Builder {
        Builder { scene, meshes: Meshes::default() }
    }

    /// What is made so far.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Meshes that tables may name from now on.
    pub fn meshes(&mut self) -> &mut Meshes {
        &mut self.meshes
    }

    /// Adds the tables of a text, as of a scene file: bodies and probes come after those that there are, other tables and
    /// keys replace what there is, and what the text leaves out stays. After an error nothing has changed.
    pub fn add(&mut self, text: &str) -> Result<()> {
        self.add_text(text, true)
    }

    /// The same of tables that nobody wrote: errors name keys, not lines.
    pub fn add_tables(&mut self, tables: &toml::Table) -> Result<()> {
        let file: PathBuf = self.scene.file.clone();
        let text = toml::to_string(tables)
            .map_err(|error| Error::input(&file, None, format!("cannot be written: {error}"), "give other values"))?;
        self.add_text(&text, false)
    }

    /// The same of a tool and its coupling, in place of any that there are.
    pub fn replace_tool(&mut self, tables: &toml::Table) -> Result<()> {
        let mut next = self.clone();
        (next.scene.tool, next.scene.coupling) = (None, None);
        next.add_tables(tables)?;
        *self = next;
        Ok(())
    }

    /// Says with what a body collides, by name; `None`: with every other.
    pub fn set_collides(&mut self, body: usize, names: Option<Vec<String>>) -> Result<()> {
        let bodies = self.scene.bodies.len();
        let Some(named) = self.scene.bodies.get(body) else {
            let problem = format!("is {body}; the scene has {bodies}, counted from 0");
            return Err(Error::key(&self.scene.file, "body", problem, "give one of them"));
        };
        for name in names.iter().flatten() {
            names::check_partner(&self.scene, named, name).map_err(|(problem, remedy)| {
                Error::key(&self.scene.file, format!("body.{}.collides", named.name), problem, remedy)
            })?;
        }
        self.scene.bodies[body].collides = names;
        Ok(())
    }

    fn add_text(&mut self, text: &str, has_lines: bool) -> Result<()> {
        let mut next = self.scene.clone();
        load::add(&mut next, &Source { file: &self.scene.file, text, has_lines, meshes: &self.meshes })?;
        self.scene = next;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::scene::{Layer, Shape, Surface, ToolShape};

    const BLOCK: &str = "layer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
                         material = { young = 1e4, poisson = 0.3, density = 1000 }\n";
    const TOOL: &str = "[tool]\nsphere = 0.01\nmass = 0.1\n";

    fn block(name: &str, more: &str) -> String {
        format!("[[body]]\nname = \"{name}\"\n{BLOCK}{more}\n")
    }

    fn refused(builder: &mut Builder, text: &str, words: &str) {
        let before = format!("{:?}", builder.scene());
        let error = builder.add(text).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
        assert_eq!(format!("{:?}", builder.scene()), before);
    }

    #[test]
    fn what_a_text_leaves_out_stays() {
        let mut builder = Builder::new(Scene::empty("s"));
        builder.add("[step]\ndt = 0.004\n[contact]\nfriction = 0.3\n[solver]\npreconditioner = \"jacobi\"").unwrap();
        builder.add(&format!("{TOOL}[coupling]\nstiffness = 10\ndamping = 1\n[haptics]\ntrust = 0.5")).unwrap();
        builder.add("[step]\nnewton = 3\n[contact]\nstiffness = 1e6").unwrap();
        builder.add(&block("a", "")).unwrap();
        builder.add(&block("b", "collides = [\"a\", \"tool\"]")).unwrap();
        let scene = builder.scene();
        assert_eq!((scene.step.dt, scene.step.newton, scene.contact.friction), (0.004, 3, 0.3));
        assert_eq!((scene.contact.stiffness, scene.haptics.trust), (Some(1e6), 0.5));
        assert!(scene.coupling.is_some() && scene.bodies.len() == 2);
        builder.add("preset = \"fast\"\n[step]\nnewton = 2").unwrap();
        let scene = builder.scene();
        assert_eq!((scene.step.dt, scene.step.newton, scene.contact.friction), (0.008, 2, 0.3));
        let other: toml::Table = "[tool]\nsphere = 0.02\nmass = 0.2".parse().unwrap();
        builder.replace_tool(&other).unwrap();
        assert!(builder.scene().coupling.is_none());
        assert!(matches!(builder.scene().tool.as_ref().unwrap().shape, ToolShape::Sphere(0.02)));
    }

    #[test]
    fn what_a_text_names_is_there_already_and_an_error_changes_nothing() {
        let mut builder = Builder::new(Scene::empty("s"));
        refused(&mut builder, &block("b", "collides = [\"a\"]"), "there is no body \"a\"");
        refused(&mut builder, "[coupling]\nstiffness = 1\ndamping = 1", "there is no [tool]");
        builder.add(&(block("a", "") + TOOL)).unwrap();
        refused(&mut builder, &(block("b", "") + &block("a", "")), "s:7: `body[1].name`: \"a\" is taken");
        let probe = "[[probe]]\nname = \"p\"\nbody = \"a\"\nnearest = [0, 0, 0]\n";
        refused(&mut builder, &(block("b", "") + probe + probe), "taken by another probe");
        builder.add(probe).unwrap();
        refused(&mut builder, probe, "taken by another probe");
        refused(&mut builder, "[[probe]]\nname = \"q\"\nbody = \"b\"\nnearest = [0, 0, 0]", "there is no body \"b\"");
        builder
            .add(&block(
                "b",
                "collides = [\"tool\"]\n[[body.core]]\nname = \"c\"\nmotion = \"dynamic\"\nbind = { all = true }",
            ))
            .unwrap();
        refused(&mut builder, "[tool]\nbody = \"b\"", "body \"b\" names \"tool\" in `collides`");
        builder.set_collides(0, Some(vec!["b".into(), "tool".into()])).unwrap();
        assert_eq!(builder.scene().bodies[0].collides, Some(vec!["b".into(), "tool".into()]));
        for (body, name, words) in
            [(0, "a", "names the body itself"), (1, "c", "no body \"c\""), (2, "a", "`body`: is 2")]
        {
            let error = builder.set_collides(body, Some(vec![name.into()])).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        builder.set_collides(1, None).unwrap();
        builder.add("[tool]\nbody = \"b\"").unwrap_err();
        builder.set_collides(0, None).unwrap();
        builder.add("[tool]\nbody = \"b\"").unwrap();
        assert!(
            builder.set_collides(0, Some(vec!["tool".into()])).unwrap_err().to_string().contains("which is a body")
        );
    }

    #[test]
    fn meshes_are_found_by_name() {
        let mut builder = Builder::new(Scene::empty("s"));
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
            "s:3: `body.a.surface.mesh`: no mesh \"inside\" was handed over",
        );
        refused(&mut builder, &body("skin", "skin"), "s:4: `body.a.layer.mesh`: no mesh \"skin\" was handed over");
        refused(&mut builder, &body("skin", "inside\", cell = \"1"), "unknown key `body.a.layer.cell`");
        builder.add(&body("skin", "inside")).unwrap();
        builder.add("[tool]\nsurface = { mesh = \"skin\" }\nmass = 1").unwrap();
        let Shape::Soft { surface: Some(Surface::Mesh(skin)), layer: Layer::Mesh(inside) } =
            &builder.scene().bodies[0].shape
        else {
            panic!("{:?}", builder.scene().bodies[0]);
        };
        // As a file's would be, it was turned.
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
            let mut builder = Builder::new(Scene::empty("s"));
            builder.add_tables(&tables).unwrap();
            let read = builder.scene().bodies[0].position.to_array();
            assert_eq!(read.map(f64::to_bits), point.map(f64::to_bits));
        }
    }
}
