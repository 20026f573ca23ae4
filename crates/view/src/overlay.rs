//! Overlays: what an image can show besides the skins (the bodies' surface meshes). A key toggles each overlay. The
//! *tool* is the rigid body that the haptic device leads.

use palpate::internal::step::Field;

/// An overlay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Overlay {
    /// Contact pressure as colours.
    Pressure,
    /// Penetration depth as colours.
    Depth,
    /// Force and torque on the tool as arrows.
    Arrows,
    /// Collision proxies (convex hulls).
    Proxies,
    /// Contact patches (places where a pair of bodies may touch along one normal) as rectangles with normals.
    ContactPatches,
    /// The layers (tetrahedral meshes of soft bodies), cut open.
    Layer,
    /// Rigid cores (rigid bodies inside soft ones, to which nodes of the layer are attached), and the bones of
    /// skeletons, which are capsules, each for one core.
    Cores,
    /// Strain energy density as colours.
    Energy,
    /// Displacement of the layer's nodes as colours.
    Displacement,
    /// Materials of bodies and of their material regions as colours, on the tetrahedral mesh (layer) cut open.
    Materials,
    /// Von Mises's stress as colours.
    VonMises,
    /// Hydrostatic pressure as colours.
    Hydrostatic,
}

impl Overlay {
    /// Every overlay with its name. The key that toggles an overlay is the overlay's number in this list, from 1; the
    /// keys of the last three are 0, v and p.
    pub const ALL: [(Overlay, &'static str); 12] = [
        (Overlay::Pressure, "pressure"),
        (Overlay::Depth, "depth"),
        (Overlay::Arrows, "force and torque"),
        (Overlay::Proxies, "proxies"),
        (Overlay::ContactPatches, "contact patches"),
        (Overlay::Layer, "layer cut open"),
        (Overlay::Cores, "cores and bones"),
        (Overlay::Energy, "strain energy"),
        (Overlay::Displacement, "displacement"),
        (Overlay::Materials, "materials"),
        (Overlay::VonMises, "von Mises stress"),
        (Overlay::Hydrostatic, "hydrostatic pressure"),
    ];

    /// Overlays that colour the bodies; only one of them is shown at a time.
    pub const COLOURS: [Overlay; 7] = [
        Overlay::Pressure,
        Overlay::Depth,
        Overlay::Energy,
        Overlay::Displacement,
        Overlay::Materials,
        Overlay::VonMises,
        Overlay::Hydrostatic,
    ];
}

/// The set of the overlays that are shown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Overlays(u32);

impl Overlays {
    /// Whether an overlay is shown.
    pub fn has(self, overlay: Overlay) -> bool {
        self.0 >> overlay as u32 & 1 == 1
    }

    /// The set of the overlays in `all`; of overlays that colour the bodies only the last is in the set.
    pub fn of(all: &[Overlay]) -> Overlays {
        let show = |mut shown: Overlays, overlay: &Overlay| {
            if !shown.has(*overlay) {
                shown.toggle(*overlay);
            }
            shown
        };
        all.iter().fold(Overlays::default(), show)
    }

    /// Whether tetrahedral meshes (layers) are shown, cut open, in place of the skins (surface meshes) of soft bodies.
    pub fn opens_layers(self) -> bool {
        self.has(Overlay::Layer) || self.has(Overlay::Materials)
    }

    /// The scalar field that skins are coloured by.
    pub fn field(self) -> Option<Field> {
        let all = [
            (Overlay::Pressure, Field::Pressure),
            (Overlay::Depth, Field::Depth),
            (Overlay::Energy, Field::StrainEnergy),
            (Overlay::Displacement, Field::Displacement),
            (Overlay::VonMises, Field::VonMises),
            (Overlay::Hydrostatic, Field::Hydrostatic),
        ];
        all.into_iter().find(|(overlay, _)| self.has(*overlay)).map(|(_, field)| field)
    }

    /// Shows a hidden overlay, hides a shown one. If the overlay colours the bodies, all others that do so are hidden.
    pub fn toggle(&mut self, overlay: Overlay) {
        let had = self.has(overlay);
        if Overlay::COLOURS.contains(&overlay) {
            Overlay::COLOURS.iter().for_each(|other| self.0 &= !(1 << *other as u32));
        }
        self.0 = if had { self.0 & !(1 << overlay as u32) } else { self.0 | 1 << overlay as u32 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlays_add_up_but_colours_replace_each_other() {
        let mut shown = Overlays::default();
        for (overlay, _) in Overlay::ALL {
            shown.toggle(overlay);
            assert!(shown.has(overlay));
        }
        let left = Overlay::ALL.into_iter().filter(|(overlay, _)| shown.has(*overlay)).count();
        assert_eq!(left, 6, "one of the overlays that colour bodies and all five others must be shown");
        assert!(shown.opens_layers() && Overlays::of(&[Overlay::Materials]).opens_layers());
        shown.toggle(Overlay::Hydrostatic);
        shown.toggle(Overlay::Arrows);
        assert!(!shown.has(Overlay::Hydrostatic) && !shown.has(Overlay::Arrows) && shown.has(Overlay::Cores));
    }
}
