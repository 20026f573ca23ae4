//! The scenes of `palpate bench features`: for each feature of the engine the smallest scene that shows it, once with
//! the feature and once without it. A soft body consists of a layer (its tetrahedral mesh), a skin (surface mesh
//! embedded in the layer) and rigid cores (rigid bodies inside it, to which nodes of the layer are attached). The tool
//! is the rigid body that the haptic device leads.

use std::path::Path;

use palpate::{Result, Scene};

/// A feature that a scene or a step can leave out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// Coulomb friction at all contacts.
    Friction,
    /// Coarse space of the two-level preconditioner.
    CoarseLevel,
    /// Contacts are searched at the vertices of the skins of both touching bodies, instead of at those of the finer
    /// skin alone.
    SecondSide,
    /// Rayleigh damping, by mass and by stiffness.
    Damping,
    /// A skin of ten times as many vertices.
    Skin,
    /// A joint between the two rigid cores of a body.
    Joints,
    /// Contact stiffness and damping (6x6 matrices), which a step computes in addition to the contact wrench, for a
    /// haptic loop.
    Stiffness,
    /// GPU timestamps, which time every stage of every step.
    Timestamps,
}

impl Feature {
    /// All features, in the order in which the report lists them.
    pub const ALL: [Feature; 8] = [
        Feature::Friction,
        Feature::CoarseLevel,
        Feature::SecondSide,
        Feature::Damping,
        Feature::Skin,
        Feature::Joints,
        Feature::Stiffness,
        Feature::Timestamps,
    ];

    /// Name of the feature in the report; its part of the results has the same name.
    pub fn name(self) -> &'static str {
        match self {
            Feature::Friction => "friction",
            Feature::CoarseLevel => "coarse-level",
            Feature::SecondSide => "second-side",
            Feature::Damping => "damping",
            Feature::Skin => "high-resolution-skin",
            Feature::Joints => "joints",
            Feature::Stiffness => "6x6-stiffness",
            Feature::Timestamps => "timestamps",
        }
    }

    /// The comparison of the scene with the feature and the scene without it, in words for the report.
    pub fn question(self) -> &'static str {
        match self {
            Feature::Friction => "coefficient 0.5 against none, a sphere pressed into a block",
            Feature::CoarseLevel => "coarse level against block Jacobi, a sphere pressed into a block of 2 MPa",
            Feature::SecondSide => "contacts at both skins against the finer skin alone, a sphere pressed into a head",
            Feature::Damping => "damped by mass and stiffness against not at all, a sphere pressed into a block",
            Feature::Skin => "20,000 skin vertices against 2,000 on the same layer, a sphere pressed into a head",
            Feature::Joints => "a falling bar with two rigid cores, joined against not joined",
            Feature::Stiffness => "computed in every step against never, a haptic loop pressing a sphere into a block",
            Feature::Timestamps => "every step timed stage by stage against none, a sphere pressed into a block",
        }
    }

    /// The scene with the feature if `with` is true, else the scene without it. For [`Feature::Stiffness`] and
    /// [`Feature::Timestamps`] both scenes are equal, and only their steps differ.
    pub fn scene(self, with: bool) -> Result<Scene> {
        let pick = |yes: &'static str, no: &'static str| if with { yes } else { no };
        let text = match self {
            Feature::Friction => block(pick("friction = 0.5", ""), "", MATERIAL),
            Feature::CoarseLevel => {
                let solver = pick("preconditioner = \"coarse\"", "preconditioner = \"jacobi\"");
                block("", solver, "young = 2e6, poisson = 0.45, density = 1000.0")
            }
            Feature::Damping => {
                let damped =
                    "young = 2e4, poisson = 0.45, density = 1000.0, damping_mass = 2.0, damping_stiffness = 0.002";
                block("", "", pick(damped, MATERIAL))
            }
            Feature::SecondSide => head(20_000, pick("sides = \"both\"", "sides = \"one\"")),
            Feature::Skin => head(if with { 20_000 } else { 2_000 }, ""),
            Feature::Joints => bar(with),
            Feature::Stiffness | Feature::Timestamps => block("", "", MATERIAL),
        };
        Scene::parse(Path::new(self.name()), &text)
    }
}

/// Two simulations that leave a feature unused for different reasons; both must cost the same.
pub enum Idle {
    /// The simulations of two scenes: one that switches the feature off, and one that does not mention the feature.
    Scenes(Box<[Scene; 2]>),
    /// Two simulations of this scene: one whose steps asked for the feature and no longer do, and one whose steps never
    /// asked for it.
    Again(Box<Scene>),
}

impl Feature {
    /// Two simulations that leave the feature unused; `None`: scene files have no key that switches the feature off.
    pub fn idle(self) -> Result<Option<Idle>> {
        let scene = |text: String| Scene::parse(Path::new(self.name()), &text);
        let plain = || scene(block("", "", MATERIAL));
        let off = match self {
            Feature::Friction => block("friction = 0.0", "", MATERIAL),
            Feature::CoarseLevel => block("", "preconditioner = \"jacobi\"", MATERIAL),
            Feature::Damping => block("", "", &format!("{MATERIAL}, damping_mass = 0.0, damping_stiffness = 0.0")),
            Feature::Stiffness | Feature::Timestamps => return Ok(Some(Idle::Again(plain()?.into()))),
            Feature::SecondSide | Feature::Skin | Feature::Joints => return Ok(None),
        };
        Ok(Some(Idle::Scenes([scene(off)?, plain()?].into())))
    }
}

/// Material of the soft bodies, in TOML: Young's modulus in Pa, Poisson's ratio, and density in kg/m^3.
const MATERIAL: &str = "young = 2e4, poisson = 0.45, density = 1000.0";
/// Virtual coupling (spring and damper) between the tool and the haptic device, in TOML.
const COUPLING: &str =
    "[coupling]\nstiffness = 500.0\ndamping = 2.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n";

/// A scene in which a sphere is pressed 4 mm deep into a block within 20 ms and then held there. The arguments are the
/// lines of the scene's tables `[contact]` and `[solver]`, and the block's material, in TOML.
fn block(contact: &str, solver: &str, material: &str) -> String {
    format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[contact]\n{contact}\n[solver]\n{solver}\n[[body]]\nname = \"block\"\n\
         layer = {{ box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [12, 8, 12] }}\n\
         material = {{ {material} }}\n[[body.core]]\nname = \"bottom\"\nmotion = \"fixed\"\n\
         bind = {{ box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }}\n\
         [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.0502, 0.0]\n{COUPLING}\
         [drive]\nkeys = [[0.0, 0.0, 0.0502, 0.0], [0.02, 0.0, 0.046, 0.0]]\n"
    )
}

/// A scene in which a sphere is pressed into the cheek of a head within 20 ms and then held there. The head's skin has
/// about `vertices` vertices; `contact` holds the lines of the scene's table `[contact]`, in TOML.
fn head(vertices: u32, contact: &str) -> String {
    format!(
        "[step]\ngravity = [0.0, 0.0, 0.0]\n[contact]\n{contact}\n[[body]]\nname = \"head\"\n\
         surface = {{ model = \"head\", vertices = {vertices} }}\nlayer = {{ cell = 0.015 }}\n\
         material = {{ {MATERIAL}, damping_stiffness = 0.002 }}\n[[body.core]]\nname = \"skull\"\nmotion = \"fixed\"\n\
         bind = {{ inset = 0.03 }}\n[tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.03, -0.02, 0.092]\n{COUPLING}\
         [drive]\nkeys = [[0.0, 0.03, -0.02, 0.092], [0.02, 0.03, -0.02, 0.083]]\n"
    )
}

/// A scene of a falling bar with a dynamic rigid core at each end; a joint connects the two cores if `joined` is true.
fn bar(joined: bool) -> String {
    let joint = if joined { "[[body.joint]]\ncores = [\"left\", \"right\"]\npoint = [0.1, 0.01, 0.01]\n" } else { "" };
    format!(
        "[[body]]\nname = \"bar\"\nlayer = {{ box = [[0.0, 0.0, 0.0], [0.2, 0.02, 0.02]], cells = [40, 4, 4] }}\n\
         material = {{ {MATERIAL} }}\n\
         [[body.core]]\nname = \"left\"\nmotion = \"dynamic\"\nbind = {{ box = [[-1.0, -1.0, -1.0], [0.041, 1.0, 1.0]] }}\n\
         [[body.core]]\nname = \"right\"\nmotion = \"dynamic\"\nbind = {{ box = [[0.159, -1.0, -1.0], [1.0, 1.0, 1.0]] }}\n{joint}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_read() {
        for feature in Feature::ALL {
            for with in [true, false] {
                assert!(
                    feature.scene(with).is_ok(),
                    "the scene of feature `{}` does not parse: {:?}",
                    feature.name(),
                    feature.scene(with).err()
                );
            }
        }
    }
}
