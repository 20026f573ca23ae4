//! Reads every mesh a scene names, for its errors alone: a run learns of a bad one before any device is touched.

use super::{Body, Layer, Scene, Shape, Surface, ToolShape, gmsh, obj};
use crate::Result;

impl Scene {
    /// Reads all surfaces and layers of the scene, refuses those that cannot serve, and keeps none.
    pub fn check_meshes(&self) -> Result<()> {
        self.bodies.iter().try_for_each(check_body)?;
        match self.tool.as_ref().map(|tool| &tool.shape) {
            Some(ToolShape::Surface(path)) => obj::read_solid(path).map(drop),
            _ => Ok(()),
        }
    }
}

fn check_body(body: &Body) -> Result<()> {
    let (surface, layer) = match &body.shape {
        Shape::Soft { surface, layer } => (surface.as_ref(), Some(layer)),
        Shape::Rigid { surface } => (Some(surface), None),
        Shape::Plane { .. } => (None, None),
    };
    if let Some(Surface::File(path)) = surface {
        obj::read_solid(path)?;
    }
    if let Some(Layer::File(path)) = layer {
        gmsh::read(path)?;
    }
    Ok(())
}
