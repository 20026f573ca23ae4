//! Pictures of a simulation without a window: for films, figures and tests. The same arrays give the same picture on a device.

use palpate::{Result, Simulation};

use super::camera::Camera;
use super::labels::Labels;
use super::moment::Moment;
use super::overlay::Overlays;
use super::picture::Picture;
use super::renderer::{Renderer, Settings};

/// Takes pictures of one simulation.
pub struct Studio {
    renderer: Renderer,
    labels: Labels,
    /// Where from.
    pub camera: Camera,
    /// What is shown besides the skins.
    pub shown: Overlays,
}

impl Studio {
    /// Of a simulation as it is now, all of it in the picture.
    pub fn new(simulation: &mut Simulation, settings: Settings) -> Result<Studio> {
        let renderer = Renderer::new(simulation, settings)?;
        let labels = Labels::new(simulation.context())?;
        Ok(Studio { camera: renderer.camera(), renderer, labels, shown: Overlays::default() })
    }

    /// What draws the pictures.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// How the simulation looks now. Between two steps; nothing of it is changed.
    pub fn picture(&mut self, simulation: &mut Simulation) -> Result<Picture> {
        let moment = Moment::of(simulation, self.renderer.origin(), self.shown)?;
        self.renderer.look(&moment, &self.camera)?;
        for slice in self.renderer.slices() {
            slice.submit_and_wait()?;
        }
        if let Some(labels) = self.labels.paint(&moment, self.renderer.legend(), self.renderer.image()?)? {
            labels.submit_and_wait()?;
        }
        self.renderer.read()
    }
}
