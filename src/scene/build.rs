//! [`Builder`]: a scene made piece by piece, of the tables of scene files and of meshes in memory.
//!
//! There is one reader of tables and one set of checks, those of `load.rs`, whether a table was written by a person or
//! made by a program.

use std::path::PathBuf;

use super::Scene;
use super::keys::Source;
use super::load;
use super::meshes::Meshes;
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

    fn add_text(&mut self, text: &str, has_lines: bool) -> Result<()> {
        let mut next = self.scene.clone();
        load::add(&mut next, &Source { file: &self.scene.file, text, has_lines, meshes: &self.meshes })?;
        self.scene = next;
        Ok(())
    }
}
