//! Which of the engine's optional features a scene uses, and why it leaves out the others; printed by the option
//! `--explain` of `palpate run`. In the reasons, "layer" is a soft body's tetrahedral mesh, "skin" the surface mesh
//! embedded in it, and "core" a rigid part of a soft body to which nodes are attached; "tool" is the rigid body that a
//! haptic device leads. Words such as `contact.friction` and `[[probe]]` are keys and tables of a scene file; a probe
//! is a skin vertex whose path is recorded. A stage is one part of the step; the depth stage finds ray hits (where rays
//! from skin vertices of one body hit the other body of a pair). A half-space is a rigid body that fills one side of a
//! plane. A floating frame is the coordinate frame of a soft body without cores; a link is the relative placement of
//! two frames.

use serde::Serialize;

use crate::prepare::Body;
use crate::scene::{Body as SceneBody, MaterialLaw, Preconditioner, Samples, Scene, Shape, Sides};
use crate::shaders::{SUPPORT_AXIS, SUPPORT_HELD, SUPPORT_PLANE};
use crate::stages::material_law;
use crate::stages::model::Model;

/// An optional feature of the engine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Feature {
    /// Name of the feature.
    pub feature: &'static str,
    /// Whether the step uses the feature. An unused feature has no GPU passes and no arrays. Some features never have
    /// passes or arrays of their own (the 6x6 stiffness, damping, the tool's weight): where such a feature is unused, a
    /// kernel skips its branch or multiplies its term by zero.
    pub used: bool,
    /// Why the feature is used, or why not.
    pub reason: String,
}

/// What decides which features are used: the scene, and the data that were prepared from the scene.
pub(super) struct Known<'a> {
    pub scene: &'a Scene,
    pub model: &'a Model,
    /// The scene's bodies; the tool is not among them.
    pub bodies: &'a [Body],
    /// The implementation (path) that the depth stage uses, graphics or compute, and why; `None` where that stage is
    /// left out.
    pub depth: Option<&'a str>,
    /// Every how many steps a step is timed; 0: no step is timed.
    pub timed_every: u64,
}

/// Lists all features: first the features of contact, then those of the soft bodies, of the tool and of measurements.
pub fn features(known: &Known) -> Vec<Feature> {
    let mut features = Vec::new();
    let mut add = |feature, used: bool, yes: String, no: &str| {
        features.push(Feature { feature, used, reason: if used { yes } else { no.into() } });
    };
    of_contact(known, &mut add);
    of_layers(known, &mut add);
    of_the_tool(known, &mut add);
    add("probes", !known.scene.probes.is_empty(), format!("{} probes", known.scene.probes.len()), "no [[probe]]");
    let timed = format!("every {}th step is timed, in command buffers of its own", known.timed_every);
    add("timestamps", known.timed_every > 0, timed, "no step is timed");
    features
}

fn of_contact(known: &Known, add: &mut impl FnMut(&'static str, bool, String, &str)) {
    let Known { scene, model, depth, .. } = known;
    let touches = !model.pairs.is_empty();
    let no_contact = |no: &'static str| if touches { no } else { "nothing can touch" };
    let friction = model.friction[0];
    let yes = format!("coefficient {friction}; viscous below a sliding speed of {} m/s", model.friction[1]);
    add("friction", touches && friction > 0.0, yes, no_contact("contact.friction is zero"));
    let both = model.pairs.iter().filter(|pair| pair.is_plane == 0 && pair.lone_side == 0).count();
    let by_triangles = model.pairs.iter().filter(|pair| pair.by_triangles != 0).count();
    let one = match scene.contact.sides {
        _ if by_triangles > 0 => "no two skins are tested by vertices",
        Sides::One => "contact.sides is \"one\": only vertices of the finer skin of each pair are tested for contact",
        Sides::Both => "only half-spaces are touched",
    };
    add(
        "second side",
        both > 0,
        format!("{both} pairs of bodies: vertices of both skins are tested for contact"),
        no_contact(one),
    );
    let reason = match scene.contact.samples {
        Samples::Vertices => "contact.samples is \"vertices\"",
        Samples::Triangles => "no pair has a rigid, nearly convex body with a single hull",
        Samples::Auto => "no pair meets the conditions of contact.samples = \"auto\"",
    };
    add(
        "overlaps of triangles",
        by_triangles > 0,
        format!("{by_triangles} pairs of bodies: the depth is integrated over triangles"),
        no_contact(reason),
    );
    add(
        "depth stage (ray hits)",
        depth.is_some(),
        depth.unwrap_or_default().into(),
        no_contact(if by_triangles > 0 { "no pair is tested by vertices" } else { "only half-spaces are touched" }),
    );
}

fn of_layers(known: &Known, add: &mut impl FnMut(&'static str, bool, String, &str)) {
    let Known { scene, model, bodies, .. } = known;
    let soft = !model.tetrahedra.is_empty();
    let no_layer = |no: &'static str| if soft { no } else { "no soft body" };
    let asked = match scene.solver.preconditioner {
        Preconditioner::Coarse => "no body deforms",
        Preconditioner::Auto => "no body is stiff enough, at its number of nodes and time step, for a coarse level",
        _ => "solver.preconditioner names a preconditioner without a coarse level",
    };
    let names: Vec<&str> =
        model.coarse.bodies.iter().filter_map(|(at, ..)| Some(bodies.get(*at)?.name.as_str())).collect();
    add("coarse level", !names.is_empty(), format!("in the preconditioner of {}", names.join(", ")), no_layer(asked));
    let damped = model.node_damping.iter().any(|x| *x > 0.0);
    add("damping by mass", damped, "added to the equations of the nodes".into(), no_layer("damping_mass is zero"));
    let damped = model.materials.iter().any(|material| material.damping > 0.0);
    add("damping by stiffness", damped, "added to the element forces".into(), no_layer("damping_stiffness is zero"));
    let surfaced = |body: &&SceneBody| matches!(body.shape, Shape::Soft { surface: Some(_), .. });
    let yes = format!("{} skin vertices, in layers of {} nodes", model.skin_nodes.len(), model.node_rest.len());
    let has_skin = scene.bodies.iter().any(|body| surfaced(&body));
    add("high-resolution skin", has_skin, yes, no_layer("the layers' boundaries are the skins"));
    let patches = model.patches.count();
    add(
        "patches",
        patches > 0,
        format!("{patches} groups of tetrahedra that share one volumetric strain"),
        no_layer("dilatation is \"element\""),
    );
    let has_neo_hookean = material_law::has(&model.materials, MaterialLaw::NeoHookean);
    add("neo-Hookean law", has_neo_hookean, "used by a material".into(), no_layer("no material uses this law"));
    add("Newton iterations", model.newton > 1, format!("{} a step", model.newton), no_layer("step.newton is 1"));
    let (cores, joints, hinges) =
        (&model.cores, model.joints.len(), model.cores.iter().filter(|c| c.hinge != glam::DVec3::ZERO));
    add("dynamic cores", !cores.is_empty(), format!("{} cores that forces move", cores.len()), "forces move no core");
    add("joints", joints > 0, format!("{joints} joints between cores"), "no two cores are joined");
    let hinges = hinges.count();
    add("hinges", hinges > 0, format!("{hinges} cores turn on a hinge"), "no core is on a hinge");
    let supported = model.held.nodes.iter().filter(|node| [SUPPORT_PLANE, SUPPORT_AXIS].contains(&(node[3] as u32)));
    let pinned = (0..model.held.nodes.len())
        .filter(|n| model.held.nodes[*n][3] as u32 == SUPPORT_HELD && model.is_free(*n))
        .count();
    let loads = model.loads.sources.len();
    let (supported, reactions) = (supported.count() + pinned, model.held.holders.len());
    add(
        "supports",
        supported > 0,
        format!("{supported} nodes may move only along planes or lines, or not at all"),
        "no [[body.support]]",
    );
    add("loads", loads > 0, format!("{loads} forces, tractions, pressures and torques"), "no [[body.load]]");
    add(
        "reactions",
        reactions > 0,
        format!("of {reactions} cores and supports"),
        "no supports, and no body asks for reactions",
    );
    let floating = model.floating.len();
    add(
        "floating frames",
        floating > 0,
        format!("{floating} bodies without a core"),
        "every soft body has a core or supports",
    );
    add(
        "links of frames",
        model.spans_frames(),
        format!("{} pairs of coordinate frames", model.links.len() - 1),
        "no element or skin has nodes in two coordinate frames",
    );
}

fn of_the_tool(known: &Known, add: &mut impl FnMut(&'static str, bool, String, &str)) {
    let Known { scene, model, .. } = known;
    let touches = scene.tool.is_some() && !model.pairs.is_empty();
    let held = scene.haptics.has_device;
    let no = if scene.tool.is_none() { "no tool" } else { "nothing can touch" };
    add("wrench", touches, "net force and torque on the tool".into(), no);
    let no = if touches { "no haptic device holds the tool, so nothing uses these matrices" } else { no };
    add("6x6 stiffness and damping", touches && held, "for the local model of contact in the haptic loop".into(), no);
    let no = if scene.tool.is_none() { "no tool" } else { "the tool is a body of its own" };
    let held_bodies = match model.tool_cores.len() {
        1 => "the haptic device is coupled to a core of a body".into(),
        count => format!("{count} haptic devices are coupled to a core of a body each"),
    };
    add("held body", model.tool_core().is_some(), held_bodies, no);
    let is_coupled = scene.coupling.is_some() || scene.further_tools.iter().any(|tool| tool.coupling.is_some());
    add("virtual coupling", is_coupled, "added to the equations of the tool".into(), "no coupling");
    let no = if scene.tool.is_none() { "no tool" } else { "no haptic device: the tool's weight acts on the tool" };
    add("weight carried by the hand", scene.tool.is_some() && held, "a haptic device holds the tool".into(), no);
}
