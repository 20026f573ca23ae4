//! Renders images of a simulation without a window, for films, figures and tests. On one GPU, equal states of the
//! simulation give equal images.

use palpate::{Result, Simulation};

use super::camera::Camera;
use super::labels::Labels;
use super::moment::{Moment, clock};
use super::overlay::Overlays;
use super::picture::Picture;
use super::renderer::{Renderer, Settings};

/// Renders images of one simulation, with legends.
pub struct Studio {
    renderer: Renderer,
    labels: Labels,
    /// The camera of the next image.
    pub camera: Camera,
    /// What the next image shows besides the skins (the bodies' surface meshes).
    pub shown: Overlays,
    /// Whether the next image shows the simulated time in a corner; at first it does not.
    pub shows_time: bool,
}

impl Studio {
    /// A studio whose camera shows all bodies of a simulation as they are now.
    pub fn new(simulation: &mut Simulation, settings: Settings) -> Result<Studio> {
        let renderer = Renderer::new(simulation, settings)?;
        let labels = Labels::new(simulation.context())?;
        Ok(Studio { camera: renderer.camera(), renderer, labels, shown: Overlays::default(), shows_time: false })
    }

    /// The renderer of the images.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Renders the simulation as it is now. Must be called between two steps; the simulation is not changed.
    pub fn picture(&mut self, simulation: &mut Simulation) -> Result<Picture> {
        let mut moment = Moment::of(simulation, self.renderer.origin(), self.shown)?;
        moment.corner = self.shows_time.then(|| clock(simulation));
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
