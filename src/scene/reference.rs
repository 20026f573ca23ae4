//! The tables of a scene file and their keys. The reader refuses every key that is not listed here, and the page
//! `docs/reference/scene.md` is written from these lists (`cargo test --test reference` compares page and lists).

/// A table of a scene file, or of a skeleton file, which lists the bones of a body.
#[derive(Debug, Clone, Copy)]
pub struct TableKeys {
    /// The table as one writes it in TOML, for example `[[body]]` or `hinge = { .. }`.
    pub heading: &'static str,
    /// What the table describes.
    pub meaning: &'static str,
    /// All keys that the table may have.
    pub keys: &'static [SceneKey],
}

/// A key of a table.
#[derive(Debug, Clone, Copy)]
pub struct SceneKey {
    /// Name of the key.
    pub name: &'static str,
    /// What the key accepts, with its unit.
    pub value: &'static str,
    /// The value that a table without the key has, as one would write it in TOML; or, in brackets, what happens
    /// without the key.
    pub default: &'static str,
    /// What the key means.
    pub meaning: &'static str,
}

impl TableKeys {
    /// Names of the keys.
    pub fn names(&self) -> Vec<&'static str> {
        self.keys.iter().map(|key| key.name).collect()
    }
}

/// Text in place of a default, for a key that must be given.
pub const REQUIRED: &str = "(required)";
/// Text in place of a default, for several keys of which a table must give exactly one.
pub const ONE_OF: &str = "(one of these)";

const fn key(name: &'static str, value: &'static str, default: &'static str, meaning: &'static str) -> SceneKey {
    SceneKey { name, value, default, meaning }
}

/// All tables, in the order in which the page `docs/reference/scene.md` lists them.
pub const TABLES: [&TableKeys; 26] = [
    &ROOT, &STEP, &SOLVER, &CONTACT, &BODY, &MODEL, &MESH, &LAYER, &MATERIAL, &REGION, &CORE, &HINGE, &BIND, &SUPPORT,
    &LOAD, &JOINT, &TOOL, &TOOLS, &COUPLING, &DRIVE, &HAPTICS, &HAND, &HAPLY, &PROBE, &SKELETON, &BONE,
];

/// The root of a scene file.
pub const ROOT: TableKeys = TableKeys {
    heading: "The scene file",
    meaning: "A scene needs a body or a tool; everything else has defaults.",
    keys: &[
        key(
            "preset",
            "`\"fast\"`, `\"balanced\"` or `\"accurate\"`",
            "(no preset)",
            "Sets the time step, the solver's tolerance and iterations, Newton's iterations and the sides of contact \
             to the cheapest settings that keep the error of the force below 7, 3.5 or 1.75 %. A key that the scene \
             gives wins over the preset.",
        ),
        key("step", "table", "(its defaults)", "Time step, gravity and Newton iterations."),
        key("solver", "table", "(its defaults)", "The linear solver."),
        key("contact", "table", "(its defaults)", "The contact law and how contact is found."),
        key("body", "array of tables", "(no bodies)", "The bodies: soft ones, rigid ones and planes."),
        key("tool", "table, or array of tables", "(no tool)", "What the haptic device leads, or several devices."),
        key(
            "coupling",
            "table",
            "(nothing holds the tool)",
            "The virtual coupling, a spring and a damper between the haptic device and the tool.",
        ),
        key(
            "drive",
            "table",
            "(the device rests where the tool starts)",
            "The reference trajectory of the haptic device.",
        ),
        key("haptics", "table", "(its defaults)", "The haptic loop: device, limits and safety."),
        key("probe", "array of tables", "(no probes)", "Skin vertices whose path is written into the trace."),
    ],
};

/// Keys of `[step]`.
pub const STEP: TableKeys = TableKeys {
    heading: "[step]",
    meaning: "Time stepping: implicit Euler.",
    keys: &[
        key("dt", "s, > 0", "0.001", "Length of a time step."),
        key(
            "gravity",
            "[x, y, z], m/s^2",
            "[0.0, -9.81, 0.0]",
            "Acceleration of gravity. It pulls on the tool as well, except where a haptic device holds the tool.",
        ),
        key(
            "newton",
            "1 to 100",
            "1",
            "Linearisations of elasticity in a step (Newton iterations), each with a linear solve.",
        ),
    ],
};

/// Keys of `[solver]`.
pub const SOLVER: TableKeys = TableKeys {
    heading: "[solver]",
    meaning: "The preconditioned conjugate gradient method that solves a step.",
    keys: &[
        key(
            "tolerance",
            "> 0, < 1",
            "(by the error)",
            "The solver stops where the residual, relative to the right-hand side in the norm of the preconditioner, \
             is below this value, and the error of the contact forces is estimated to be below five times this value \
             (a thousandth at least) of these forces. Without this key it stops between 1e-2 and 1e-5, where the error \
             that it leaves is estimated to be below a twentieth of that of the time step, and that of the contact \
             forces below a thousandth.",
        ),
        key(
            "max_iterations",
            "1 to 10000",
            "200",
            "The solver stops after this many iterations; flag `not_converged` is raised if the residual is then \
             above ten times the tolerance (1e-4 without one) and above what single precision can reach, or the error of \
             the contact forces above ten times what is allowed.",
        ),
        key(
            "preconditioner",
            "`\"auto\"`, `\"jacobi\"` or `\"coarse\"`",
            "\"auto\"",
            "Block Jacobi alone, or with an additive coarse space (two-level additive Schwarz) on every soft body; \
             `auto` decides for each body by its stiffness.",
        ),
        key(
            "operator",
            "`\"auto\"` or `\"matrix-free\"`",
            "\"auto\"",
            "`auto` assembles the stiffness of the elements once a solve, as a matrix of 3x3 blocks; a scene with F-bar \
             materials is solved without a matrix, element by element in each iteration, as `matrix-free` solves all.",
        ),
    ],
};

/// Keys of `[contact]`.
pub const CONTACT: TableKeys = TableKeys {
    heading: "[contact]",
    meaning: "Penalty contact: pressure grows with the depth of overlap.",
    keys: &[
        key(
            "stiffness",
            "`\"auto\"` or N/m^3, > 0",
            "\"auto\"",
            "Pressure per metre of depth. `auto` is 20 E / (1 - nu^2) / (mean edge of the layer) of the softer body.",
        ),
        key(
            "damping",
            "`\"auto\"` or N s/m^3, >= 0",
            "\"auto\"",
            "Pressure per speed of approach. `auto` is the stiffness times the time step.",
        ),
        key("friction", ">= 0", "0.0", "Coulomb's coefficient, for all contacts."),
        key(
            "friction_speed",
            "m/s, >= 1e-6",
            "0.001",
            "Sliding speed below which friction is viscous, so that a sticking contact creeps.",
        ),
        key(
            "texel",
            "`\"auto\"` or m, > 0",
            "\"auto\"",
            "Edge of the cells of the depth stage's grid. It changes the time that the stage takes, not its result.",
        ),
        key(
            "depth_limit",
            "m, > 0",
            "0.02",
            "Greatest depth that is expected: flag `depth_beyond_limit` is raised where a contact is deeper, and \
             `not_a_height_field` where a second layer of skin lies within this depth.",
        ),
        key(
            "depth",
            "`\"auto\"`, `\"graphics\"` or `\"compute\"`",
            "\"auto\"",
            "How the depth stage finds where rays meet triangles. Both ways give the same result; `auto` is the \
             faster one on the device. The option `--depth` wins.",
        ),
        key(
            "sides",
            "`\"both\"` or `\"one\"`",
            "\"both\"",
            "Whose skin vertices are tested for contact: those of both bodies, each side counting half, or those of \
             the body with the finer skin, counting in full. Pairs that are tested by triangles have one side.",
        ),
        key(
            "samples",
            "`\"auto\"`, `\"vertices\"` or `\"triangles\"`",
            "\"auto\"",
            "What of a skin is tested for contact: its vertices, or its triangles, over each of which the depth is \
             integrated. Triangles need a rigid, nearly convex body in the pair, with one hull and no dynamics of its \
             own but the tool's, and are those of the other body; `auto` takes them where that rigid body has sharp \
             edges or the coarser skin, or where their edges are longer than a fifth of its second longest side, \
             unless their body is a thin sheet; and never where they are longer than three quarters of the second \
             longest side of either body.",
        ),
    ],
};

/// Keys of `[[body]]`.
pub const BODY: TableKeys = TableKeys {
    heading: "[[body]]",
    meaning: "A body: soft with a `layer`, rigid with a `surface` alone, or a `plane`. The file's units are those \
             of the body's mesh files, which `units` and `scale` turn into metres; the body's pose comes after that.",
    keys: &[
        key(
            "name",
            "a name",
            REQUIRED,
            "Name of the body, unique in the scene, of letters, digits, `_`, `-` and `.`. Output files are called \
             after it.",
        ),
        key(
            "surface",
            "`\"FILE\"` (.obj, .stl, .ply, .gltf, .glb, .vtp, .vtu or .vtk), `{ model = .. }` or, from a program, \
             `{ mesh = \"..\" }`",
            "(the layer's boundary)",
            "The skin: the surface mesh that touches and is seen. A body with a surface and no layer is rigid.",
        ),
        key(
            "layer",
            "`{ cell = .. }`, `{ across = .. }`, `{ box = .. }`, `\"FILE\"` (.msh, .vtu, .vtk, .node or .ele) or, from a \
             program, `{ mesh = \"..\" }`",
            "(none: the body is rigid)",
            "The tetrahedral mesh of a soft body.",
        ),
        key(
            "plane",
            "[nx, ny, nz, d], m",
            "(none)",
            "A fixed half-space below the plane n . x = d; such a body has no other key but `name` and `collides`.",
        ),
        key(
            "hulls",
            "1 to 256",
            "(40 at most)",
            "Greatest number of collision proxies, convex hulls that cover the skin for the broad phase.",
        ),
        key(
            "units",
            "`\"m\"`, `\"cm\"`, `\"mm\"` or `\"in\"`",
            "(metres)",
            "Unit of the file's coordinates. Without it, a note tells of a body above 10 m or below 1 mm.",
        ),
        key("scale", "> 0", "1.0", "Uniform scale of the file's coordinates, besides `units`."),
        key("position", "[x, y, z], m", "[0.0, 0.0, 0.0]", "Where the file's origin lies in the world."),
        key("orientation", "[x, y, z, w], unit quaternion", "[0.0, 0.0, 0.0, 1.0]", "Orientation in the world."),
        key("velocity", "[x, y, z], m/s", "[0.0, 0.0, 0.0]", "Initial velocity."),
        key("material", "table", "(required of a soft body)", "The elastic material."),
        key("region", "array of tables", "(none)", "Parts of the layer that have another material."),
        key(
            "dilatation",
            "`\"element\"` or `\"patch\"`",
            "\"element\"",
            "Volume over which the volumetric strain is constant: each tetrahedron, or a patch of tetrahedra (F-bar), \
             which prevents locking as Poisson's ratio nears 0.5; not with the neo-Hookean law.",
        ),
        key(
            "collides",
            "array of names",
            "(every other body and the tool)",
            "Bodies that this one may touch; `\"tool\"` names the tool. Two tools of `[[tool]]` touch only if one of them \
             has this key.",
        ),
        key(
            "core",
            "array of tables",
            "(none: a soft body is free)",
            "Rigid parts of a soft body, with the nodes that are attached to them.",
        ),
        key(
            "support",
            "array of tables",
            "(none)",
            "Nodes of a soft body that may move only along a plane or a line, or not at all.",
        ),
        key("load", "array of tables", "(none)", "Forces, tractions, pressures and torques on the body."),
        key(
            "reactions",
            "true or false",
            "(true if it has supports)",
            "Whether the trace has force and torque of each support, and of each fixed or driven core.",
        ),
        key("joint", "array of tables", "(none)", "Ball joints between cores."),
        key("skeleton", "`\"FILE.toml\"`", "(none)", "Bones: each becomes a core."),
        key("bones", "`\"fixed\"` or `\"dynamic\"`", "\"fixed\"", "Motion of the bones that no `[[body.core]]` names."),
        key(
            "motion",
            "`\"fixed\"`, `\"driven\"` or `\"dynamic\"`",
            "\"fixed\"",
            "How a rigid body moves: not at all, kinematically by `keys`, or by forces.",
        ),
        key(
            "keys",
            "array of [t, x, y, z] or [t, x, y, z, qx, qy, qz, qw], or `\"FILE.csv\"`",
            "(required of what is driven)",
            "Poses of a driven rigid body's frame over time (s, m, unit quaternion).",
        ),
        key(
            "mass",
            "kg, > 0",
            "(required of a dynamic rigid body)",
            "Mass of a dynamic rigid body, spread evenly over its volume.",
        ),
        key(
            "hinge",
            "table",
            "(none)",
            "A line fixed in the world about which a dynamic rigid body turns, its only motion.",
        ),
        key(
            "repair",
            "true or false",
            "true",
            "Whether a faulty surface file is repaired (the notes say how); otherwise it is refused.",
        ),
    ],
};

/// Keys of `surface = { model = .. }`.
pub const MODEL: TableKeys = TableKeys {
    heading: "surface = { model = .. }",
    meaning: "A surface that the program generates.",
    keys: &[
        key("model", "`\"head\"`, `\"gear\"`, `\"human\"`, `\"pumpkin\"` or `\"sphere\"`", REQUIRED, "Which surface."),
        key(
            "vertices",
            "500 (gear and human: 2000, sphere: 100) to 400000",
            "(head 44000, gear 29000, human 13000, pumpkin 30000, sphere 2500)",
            "Number of vertices, which the surface has exactly.",
        ),
    ],
};

/// Keys of `surface = { mesh = .. }` and of `layer = { mesh = .. }`.
pub const MESH: TableKeys = TableKeys {
    heading: "surface = { mesh = .. } and layer = { mesh = .. }",
    meaning: "A mesh in memory, which a program has added to the scene under a name.",
    keys: &[key("mesh", "a name", REQUIRED, "Name of the mesh.")],
};

/// Keys of `layer = { .. }`.
pub const LAYER: TableKeys = TableKeys {
    heading: "layer = { .. }",
    meaning: "A tetrahedral mesh that is generated: cells that fill the surface, or a box.",
    keys: &[
        key(
            "cell",
            "in the file's units, > 0",
            ONE_OF,
            "Edge of the cells that fill the surface (isosurface stuffing).",
        ),
        key(
            "across",
            "1 to 1000",
            ONE_OF,
            "Number of cells along the largest extent of the surface, instead of `cell`.",
        ),
        key(
            "grade",
            "1, 2, 4 or 8",
            "1",
            "Edge of the largest cells deep inside, as a multiple of those at the surface.",
        ),
        key(
            "thickness",
            "in the file's units, > 0",
            "(the whole inside)",
            "Thickness of a shell below the surface; what is deeper stays empty.",
        ),
        key("box", "[[x, y, z], [x, y, z]], in the file's units", ONE_OF, "Least and greatest corner of a box."),
        key(
            "cells",
            "[i, j, k]",
            "(required of a box)",
            "Number of cells of a box along each axis; six tetrahedra each.",
        ),
    ],
};

/// Keys of `material = { .. }`.
pub const MATERIAL: TableKeys = TableKeys {
    heading: "material = { .. }",
    meaning: "An isotropic elastic material. In a region, keys that are left out have the body's values.",
    keys: &[
        key(
            "law",
            "`\"corotational\"` or `\"neo-hookean\"`",
            "\"corotational\"",
            "The material law: corotational linear elasticity, or a stable neo-Hookean law for great stretches.",
        ),
        key("young", "Pa, > 0", REQUIRED, "Young's modulus."),
        key("poisson", "-0.5 to below 0.5", REQUIRED, "Poisson's ratio."),
        key("density", "kg/m^3, > 0", REQUIRED, "Density."),
        key("damping_mass", "1/s, >= 0", "0.0", "Rayleigh damping by mass."),
        key("damping_stiffness", "s, >= 0", "0.0", "Rayleigh damping by stiffness."),
    ],
};

/// Keys of `[[body.region]]`.
pub const REGION: TableKeys = TableKeys {
    heading: "[[body.region]]",
    meaning: "Tetrahedra with a material of their own. A tetrahedron in several regions belongs to the first.",
    keys: &[
        key(
            "group",
            "a name or a number",
            ONE_OF,
            "A group of the layer's file: a physical group of volumes of Gmsh, the first attribute of TetGen, or the \
             cell data `group` of VTK (else its first array of whole numbers).",
        ),
        key(
            "box",
            "[[x, y, z], [x, y, z]], in the file's units",
            ONE_OF,
            "The tetrahedra whose centroid lies in a box.",
        ),
        key("sphere", "[x, y, z, r], in the file's units", ONE_OF, "The tetrahedra whose centroid lies in a sphere."),
        key("material", "table", REQUIRED, "The material of the region."),
    ],
};

/// Keys of `[[body.core]]`.
pub const CORE: TableKeys = TableKeys {
    heading: "[[body.core]]",
    meaning: "A rigid part of a soft body, with the nodes of the layer that are attached to it. A node \
             that several cores name is attached to the first.",
    keys: &[
        key("name", "a name", REQUIRED, "Name of the core; with the name of a bone it says how that bone moves."),
        key(
            "motion",
            "`\"fixed\"`, `\"driven\"` or `\"dynamic\"`",
            "\"fixed\"",
            "How the core moves: not at all, kinematically by `keys`, or by forces.",
        ),
        key(
            "keys",
            "array of [t, x, y, z] or [t, x, y, z, qx, qy, qz, qw], or `\"FILE.csv\"`",
            "(required of what is driven)",
            "Poses of the body's frame over time (s, m, unit quaternion): a key that equals the body's `position` and \
             `orientation` is the core's place at rest.",
        ),
        key("mass", "kg, > 0", "(that of the attached nodes)", "Mass of a dynamic core."),
        key("hinge", "table", "(none)", "A line fixed in the world about which a dynamic core turns, its only motion."),
        key("bind", "table", "(required unless the core is a bone)", "Which nodes are attached."),
    ],
};

/// Keys of `hinge = { .. }`.
pub const HINGE: TableKeys = TableKeys {
    heading: "hinge = { .. }",
    meaning: "A line fixed in the world.",
    keys: &[
        key("point", "[x, y, z], in the file's units", REQUIRED, "A point of the line, in the coordinates of `bind`."),
        key("axis", "[x, y, z]", REQUIRED, "Direction of the line, in the coordinates of `bind`."),
    ],
};

/// Keys of `bind = { .. }`.
pub const BIND: TableKeys = TableKeys {
    heading: "bind = { .. }",
    meaning: "The nodes that are attached to a core, that a support holds, or on which a load acts.",
    keys: &[
        key("inset", "in the file's units, >= 0", ONE_OF, "Nodes that lie at least so deep below the surface."),
        key("box", "[[x, y, z], [x, y, z]], in the file's units", ONE_OF, "Nodes in a box."),
        key("sphere", "[x, y, z, r], in the file's units", ONE_OF, "Nodes in a sphere."),
        key("nodes", "array of numbers", ONE_OF, "Nodes by their number in the layer's file, from 0."),
        key(
            "group",
            "a name or a number",
            ONE_OF,
            "Nodes of a group of the layer's file: a Gmsh physical group of points, curves, surfaces or volumes, or a \
             group of tetrahedra.",
        ),
        key("all", "true", ONE_OF, "All nodes."),
    ],
};

/// Keys of `[[body.support]]`.
pub const SUPPORT: TableKeys = TableKeys {
    heading: "[[body.support]]",
    meaning: "Nodes of a soft body that are held from outside. Directions are those of the body's file; planes and \
             lines stay where they are in the world, through each node's place at rest. Several supports may hold a \
             node; one that is attached to a core follows the core.",
    keys: &[
        key("name", "a name", REQUIRED, "Name of the support, unique among the body's cores and supports."),
        key("plane", "[nx, ny, nz]", ONE_OF, "Normal of the planes in which the nodes may move: rollers, symmetry."),
        key("axis", "[x, y, z]", ONE_OF, "Direction of the lines along which the nodes may move."),
        key("point", "true", ONE_OF, "The nodes do not move."),
        key("bind", "table", REQUIRED, "Which nodes are held."),
    ],
};

/// Keys of `[[body.load]]`.
pub const LOAD: TableKeys = TableKeys {
    heading: "[[body.load]]",
    meaning: "A force on a body, besides its weight; vectors are in world axes. What acts on nodes that do not move counts \
             in the reactions alone. The loads of a dynamic rigid body act on the body, and have neither `bind` nor `core`.",
    keys: &[
        key("name", "a name", REQUIRED, "Name of the load, unique among the body's loads."),
        key(
            "force",
            "[x, y, z], N",
            ONE_OF,
            "A force, which the nodes share equally, or which acts at the core's centre of mass.",
        ),
        key(
            "traction",
            "[x, y, z], Pa",
            ONE_OF,
            "A force per area at rest, on the triangles of the skin whose corners all lie in `bind`.",
        ),
        key(
            "pressure",
            "Pa",
            ONE_OF,
            "A pressure on such triangles, against the outward normal; it turns and grows with them.",
        ),
        key(
            "torque",
            "[x, y, z], N m",
            ONE_OF,
            "A torque on the core; on a hinge only the part about its axis turns the core, which takes no `force`.",
        ),
        key("bind", "table", ONE_OF, "The nodes, or the part of the skin."),
        key("core", "a name", ONE_OF, "The dynamic core on which a force or a torque acts."),
        key(
            "factors",
            "array of [t, factor]",
            "(1 at all times)",
            "Factors of the load over time (s); linear in between, constant before and after.",
        ),
    ],
};

/// Keys of `[[body.joint]]`.
pub const JOINT: TableKeys = TableKeys {
    heading: "[[body.joint]]",
    meaning: "A ball joint between two cores, one of them dynamic. Joints between dynamic cores must not form loops.",
    keys: &[
        key("cores", "two names", REQUIRED, "The two cores; the second turns about the first."),
        key(
            "point",
            "[x, y, z], in the file's units",
            REQUIRED,
            "Where the two cores are joined, in the coordinates of `bind`.",
        ),
        key(
            "axis",
            "[x, y, z]",
            "(required with `swing` or `twist`)",
            "Direction along the second core, in the coordinates of `bind`.",
        ),
        key("stiffness", "N m/rad, >= 0", "0.0", "Stiffness towards the pose at rest."),
        key("damping", "N m s/rad, >= 0", "0.0", "Damping of the relative rotation."),
        key("swing", "rad, > 0, < pi", "(no limit)", "How far the axis may turn from its direction at rest."),
        key("twist", "rad, > 0, < pi", "(no limit)", "How far the second core may turn about the axis, either way."),
    ],
};

/// Keys of `[tool]`.
pub const TOOL: TableKeys = TableKeys {
    heading: "[tool]",
    meaning: "The rigid body that the haptic device leads, or a body of the scene that it holds.",
    keys: &[
        key("sphere", "m, > 0", ONE_OF, "Radius of a sphere."),
        key(
            "surface",
            "`\"FILE\"`, as of a body, or, from a program, `{ mesh = \"..\" }`",
            ONE_OF,
            "A closed surface mesh.",
        ),
        key(
            "body",
            "a name",
            ONE_OF,
            "A body of the scene, held by its first core, which must be dynamic; with this key the table has no \
             other.",
        ),
        key("mass", "kg, > 0", "(required, except with `body`)", "Mass, spread evenly over the volume."),
        key("position", "[x, y, z], m", "[0.0, 0.0, 0.0]", "Where the tool's centre of mass lies at the start."),
        key("orientation", "[x, y, z, w], unit quaternion", "[0.0, 0.0, 0.0, 1.0]", "Orientation at the start."),
        key("velocity", "[x, y, z], m/s", "[0.0, 0.0, 0.0]", "Velocity at the start."),
        key("units", "`\"m\"`, `\"cm\"`, `\"mm\"` or `\"in\"`", "(metres)", "Unit of the file's coordinates."),
        key("scale", "> 0", "1.0", "Uniform scale of the file's coordinates, besides `units`."),
        key("repair", "true or false", "true", "Whether a faulty surface file is repaired; otherwise it is refused."),
    ],
};

/// Keys of `[[tool]]`.
pub const TOOLS: TableKeys = TableKeys {
    heading: "[[tool]]",
    meaning: "Several tools, four at most, each led by a haptic device of its own. Each is a body of the scene, and has its \
              own coupling and trajectory in place of `[coupling]` and `[drive]`. In a session devices lead all tools up \
              to the last that has `haptics`, a scripted one each tool that has none; the tools after it follow their \
              trajectories. `[haptics]` is that of the first tool.",
    keys: &[
        key(
            "name",
            "a name",
            REQUIRED,
            "Name of the tool; the trace's columns of all but the first tool begin with it.",
        ),
        key("body", "a name", REQUIRED, "A body of the scene, held by its first core, which must be dynamic."),
        key("coupling", "table, as `[coupling]`", "(nothing holds the tool)", "The virtual coupling of this tool."),
        key("drive", "table, as `[drive]`", "(the device rests where the tool starts)", "Trajectory of its device."),
        key("haptics", "table, as `[haptics]`", "(no device)", "The haptic device and the haptic loop of this tool."),
    ],
};

/// Keys of `[coupling]`.
pub const COUPLING: TableKeys = TableKeys {
    heading: "[coupling]",
    meaning: "The virtual coupling: a spring and a damper between the haptic device and the tool. In a session with a \
             device the values are upper bounds; the haptic loop lowers them to what the device renders stably.",
    keys: &[
        key("stiffness", "N/m, >= 0", REQUIRED, "Stiffness of the spring."),
        key("damping", "N s/m, >= 0", REQUIRED, "Damping."),
        key("angular_stiffness", "N m/rad, >= 0", "0.0", "Stiffness of the relative rotation."),
        key("angular_damping", "N m s/rad, >= 0", "0.0", "Damping of the relative rotation."),
    ],
};

/// Keys of `[drive]`.
pub const DRIVE: TableKeys = TableKeys {
    heading: "[drive]",
    meaning: "The reference trajectory: the pose of the haptic device over time, interpolated linearly (rotations \
             spherically) and held at the ends. A run lasts until its last key.",
    keys: &[
        key("keys", "array of [t, x, y, z] or [t, x, y, z, qx, qy, qz, qw]", ONE_OF, "Poses (s, m, unit quaternion)."),
        key(
            "path",
            "`\"FILE.csv\"`",
            ONE_OF,
            "A CSV file with a pose in each row; a first row without any number is a heading.",
        ),
    ],
};

/// Keys of `[haptics]`.
pub const HAPTICS: TableKeys = TableKeys {
    heading: "[haptics]",
    meaning: "The haptic loop, used where a device holds the tool in real time.",
    keys: &[
        key(
            "device",
            "`\"scripted\"`, `\"hand\"`, `\"replay\"`, `\"haply\"`, `\"touch\"`, `\"force-dimension\"`, \
             `\"space-mouse\"`, `\"game-pad\"` or `\"openxr\"`",
            "\"scripted\"",
            "What holds the tool: the keys of `[drive]`, a simulated human who means to follow them, a recording, or \
             a device of Haply, 3D Systems (OpenHaptics) or Force Dimension; or a SpaceMouse, a game pad or an OpenXR \
             controller, which play no force. All but `scripted` start a session without `--haptics`.",
        ),
        key(
            "profile",
            "a name (see the profiles of devices)",
            "(the device's own)",
            "Limits and abilities of the device. For a real device it may only lower the limits of the device itself.",
        ),
        key(
            "resolution",
            "m, > 0, at most 0.01",
            "(the profile's)",
            "Step of the device's encoders, as `palpate devices --calibrate` measures it. The gains of the \
             coupling follow it.",
        ),
        key("rate", "Hz, 50 to 4000", "1000.0", "Force updates per second."),
        key(
            "max_force",
            "N, > 0",
            "(the profile's)",
            "Greatest force; this key and the next four may only lower what the profile allows.",
        ),
        key("max_torque", "N m, > 0", "(the profile's)", "Greatest torque."),
        key(
            "max_slew",
            "N/s, > 0",
            "(from zero to the greatest force in 4 ms)",
            "Greatest rate of change of the force.",
        ),
        key(
            "workspace",
            "m, > 0",
            "(the profile's)",
            "Radius of the workspace about the place where the device was opened.",
        ),
        key("watchdog", "s, > 0", "(1 s)", "Age of the newest wrench beyond which the force fades to zero."),
        key(
            "local_model",
            "true or false",
            "true",
            "Whether the force follows the local contact model of the newest wrench between two steps; otherwise the \
             raw force is held.",
        ),
        key(
            "trust",
            "m, > 0",
            "0.008",
            "Distance from the tool's place in the newest wrench up to which the local model is followed.",
        ),
        key(
            "passivity",
            "true or false",
            "true",
            "Whether the passivity controller acts; otherwise energy is only observed.",
        ),
        key(
            "longest_step",
            "s, > 0",
            "0.02",
            "Longest time step of the simulation in a session. A step is as long as it takes to compute, and at least \
             `dt`; if computing takes longer than this value, bodies move slower than in real time.",
        ),
        key("hand", "table", "(its defaults)", "The simulated human, for `device = \"hand\"`."),
        key("haply", "table", "(its defaults)", "The service of a Haply device, for `device = \"haply\"`."),
        key(
            "unit",
            "text",
            "(the first device)",
            "Which of several devices: its name in the maker's configuration (`touch`), its serial number \
             (`force-dimension`), its name or path in the system (`space-mouse`, `game-pad`), or the hand, `left` or \
             `right` (`openxr`).",
        ),
        key("recording", "`\"FILE\"`", "(none)", "The recorded session, for `device = \"replay\"`."),
    ],
};

/// Keys of `hand = { .. }`.
pub const HAND: TableKeys = TableKeys {
    heading: "hand = { .. }",
    meaning: "The simulated human: a mass on a spring and a damper whose other end follows `[drive]`, and the \
             mechanism that it holds.",
    keys: &[
        key("mass", "kg, 0.001 to 10", "0.15", "Mass of hand and mechanism."),
        key("stiffness", "N/m, 0 to 1e5", "300.0", "Stiffness of the arm."),
        key("damping", "N s/m, 0 to 1000", "5.0", "Damping of the arm."),
        key("device_damping", "N s/m, 0 to 1000", "0.5", "Viscous friction of the mechanism."),
        key("friction", "N, 0 to 100", "0.05", "Coulomb friction of the mechanism."),
        key("inertia", "kg m^2, 1e-6 to 1", "0.001", "Moment of inertia of hand and mechanism."),
        key("angular_stiffness", "N m/rad, 0 to 1000", "2.0", "Angular stiffness of the wrist."),
        key("angular_damping", "N m s/rad, 0 to 10", "0.04", "Angular damping of wrist and mechanism."),
        key("quantum", "m, 0 to 0.01", "(the profile's)", "Resolution of the encoder."),
        key("delay", "s, 0 to 1", "0.0", "Time from a commanded wrench to its effect, a whole number of 0.1 ms."),
    ],
};

/// Keys of `haply = { .. }`.
pub const HAPLY: TableKeys = TableKeys {
    heading: "haply = { .. }",
    meaning: "How to reach Haply's Inverse service.",
    keys: &[
        key(
            "address",
            "`\"ws://HOST:PORT\"`",
            "\"ws://localhost:10001\"",
            "Address of the service; it must be on this machine.",
        ),
        key("trust_remote", "true or false", "false", "Whether the service may be on another machine."),
        key("device_id", "text", "(the first device)", "Id of the device."),
        key(
            "grip",
            "text",
            "(the first grip that is awake)",
            "Id of the grip whose orientation and buttons count; `\"none\"`: no grip. Of several Haply each names its own.",
        ),
        key(
            "force_key",
            "`\"vector\"` or `\"values\"`",
            "(by the service's version)",
            "Key under which forces are sent: `vector` from version 3.5 of the service on, `values` before.",
        ),
    ],
};

/// Keys of `[[probe]]`.
pub const PROBE: TableKeys = TableKeys {
    heading: "[[probe]]",
    meaning: "A skin vertex whose path is written into the trace.",
    keys: &[
        key("name", "a name", REQUIRED, "The names of the probe's columns begin with it."),
        key("body", "a name", REQUIRED, "The body on whose skin the vertex lies."),
        key("nearest", "[x, y, z], in the file's units", REQUIRED, "The vertex nearest to this point."),
    ],
};

/// Keys of the skeleton file.
pub const SKELETON: TableKeys = TableKeys {
    heading: "The skeleton file",
    meaning: "The file that the key `skeleton` of a body names.",
    keys: &[key("bone", "array of tables", REQUIRED, "The bones, parents before children.")],
};

/// Keys of `[[bone]]`.
pub const BONE: TableKeys = TableKeys {
    heading: "[[bone]]",
    meaning: "A bone: a capsule in the coordinates of `bind`. The nodes in the capsule are attached to the bone; \
             where capsules overlap, to the bone whose axis is nearest, relative to its radius there. A dynamic bone \
             and its parent share a ball joint.",
    keys: &[
        key("name", "a name", REQUIRED, "Name of the bone."),
        key("parent", "a name", "(none: a root)", "A bone before this one."),
        key("joint", "[x, y, z], in the file's units", REQUIRED, "Where the bone turns about its parent."),
        key("ends", "[[x, y, z], [x, y, z]], in the file's units", REQUIRED, "Ends of the capsule's axis."),
        key("radius", "in the file's units, > 0", ONE_OF, "Radius of the capsule."),
        key("radii", "[r, r], in the file's units", ONE_OF, "Radii at the two ends."),
        key("stiffness", "N m/rad, >= 0", "0.0", "Stiffness towards the pose at rest."),
        key("damping", "N m s/rad, >= 0", "0.0", "Damping of the relative rotation."),
        key("swing", "rad, > 0, < pi", "(no limit)", "How far the bone's axis may turn from its direction at rest."),
        key("twist", "rad, > 0, < pi", "(no limit)", "How far the bone may turn about its axis, either way."),
    ],
};

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::path::Path;

    use super::*;
    use crate::Scene;

    /// For each tested table the scenes that test its keys, in which `@` stands where a key is put in; a table may have
    /// several scenes, since some keys exclude each other. After another key of an inline table the mark is `, @`.
    const SCENES: [(&TableKeys, &[&str]); 15] = [
        (&STEP, &["[step]\n@"]),
        (&SOLVER, &["[solver]\n@"]),
        (&CONTACT, &["[contact]\n@"]),
        (
            &BODY,
            &[
                "[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
                 material = { young = 1, poisson = 0, density = 1 }\nskeleton = \"bones.toml\"\n@",
                "[[body]]\nname = \"b\"\nsurface = \"ball.obj\"\n@",
            ],
        ),
        (
            &LAYER,
            &[
                "[[body]]\nname = \"b\"\nsurface = { model = \"head\" }\nlayer = { cell = 0.1, @ }\n\
                 material = { young = 1, poisson = 0, density = 1 }",
                "[[body]]\nname = \"b\"\nsurface = { model = \"head\" }\nlayer = { across = 10, @ }\n\
                 material = { young = 1, poisson = 0, density = 1 }",
            ],
        ),
        (
            &MATERIAL,
            &["[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
              material = { young = 1, poisson = 0, density = 1, @ }"],
        ),
        (
            &CORE,
            &["[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
              material = { young = 1, poisson = 0, density = 1 }\n\
              [[body.core]]\nname = \"c\"\nbind = { all = true }\n@"],
        ),
        (
            &SUPPORT,
            &["[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
              material = { young = 1, poisson = 0, density = 1 }\n\
              [[body.support]]\nname = \"c\"\npoint = true\nbind = { all = true }\n@"],
        ),
        (
            &LOAD,
            &["[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
              material = { young = 1, poisson = 0, density = 1 }\n\
              [[body.load]]\nname = \"c\"\npressure = 1\nbind = { all = true }\n@"],
        ),
        (
            &JOINT,
            &["[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [1, 1, 1] }\n\
              material = { young = 1, poisson = 0, density = 1 }\n\
              [[body.core]]\nname = \"c\"\nmotion = \"dynamic\"\nbind = { all = true }\n\
              [[body.core]]\nname = \"d\"\nmotion = \"dynamic\"\nbind = { all = true }\n\
              [[body.joint]]\ncores = [\"c\", \"d\"]\npoint = [0, 0, 0]\n@"],
        ),
        (&TOOL, &["[tool]\nsphere = 1\nmass = 1\n@", "[tool]\nsurface = \"ball.obj\"\nmass = 1\n@"]),
        (&COUPLING, &["[tool]\nsphere = 1\nmass = 1\n[coupling]\nstiffness = 1\ndamping = 1\n@"]),
        (&HAPTICS, &["[haptics]\n@"]),
        (
            &HAND,
            &["[haptics]\ndevice = \"hand\"\nhand = { mass = 0.15, @ }", "[haptics]\ndevice = \"hand\"\nhand = { @ }"],
        ),
        (&HAPLY, &["[haptics]\ndevice = \"haply\"\nhaply = { @ }"]),
    ];

    fn read(folder: &Path, template: &str, key: &str) -> Option<String> {
        let ground = "\n[[body]]\nname = \"ground\"\nplane = [0, 1, 0, 0]\n";
        let tool = "[tool]\nsphere = 1\nmass = 1\n[coupling]\nstiffness = 1\ndamping = 1\n";
        let rest = format!("{ground}{}", if template.contains("[tool]") { "" } else { tool });
        let text = if key.is_empty() { template.replace(", @", "") } else { template.to_owned() };
        let scene = Scene::parse(&folder.join("scene.toml"), &(text.replace('@', key) + &rest));
        scene.ok().map(|scene| format!("{scene:?}"))
    }

    /// A folder with the files that the scenes name.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let skeleton = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/human-skeleton.toml");
        std::fs::copy(skeleton, folder.path().join("bones.toml")).unwrap();
        std::fs::write(folder.path().join("ball.obj"), "").unwrap();
        folder
    }

    #[test]
    fn a_key_that_is_given_its_default_changes_nothing() {
        let folder = folder();
        let read = |template: &str, key: &str| read(folder.path(), template, key);
        let mut checked = 0;
        for (table, templates) in SCENES {
            for key in table.keys.iter().filter(|key| !key.default.starts_with('(')) {
                let line = format!("{} = {}", key.name, key.default);
                let pairs = templates.iter().filter_map(|template| Some((read(template, "")?, read(template, &line)?)));
                let pairs: Vec<_> = pairs.collect();
                assert!(!pairs.is_empty(), "{}: `{line}` is refused", table.heading);
                for (without, with) in pairs {
                    assert_eq!(without, with, "{}: `{line}` changes the scene", table.heading);
                }
                checked += 1;
            }
        }
        let defaults = TABLES.iter().flat_map(|table| table.keys).filter(|key| !key.default.starts_with('('));
        // The two keys of `[[bone]]` that have defaults are not checked, since bones stand in a file of their own.
        assert_eq!(checked + 2, defaults.count());
    }

    /// Numbers that a key accepts and numbers that it refuses, by the bounds that its description of values states:
    /// `A to B`, `A to below B`, `> A`, `>= A` and `< A`.
    fn bounds(value: &str) -> (Vec<f64>, Vec<f64>) {
        let number = |text: &str| match text.trim_matches([',', ' ']) {
            "pi" => Some(std::f64::consts::PI),
            text => text.parse::<f64>().ok(),
        };
        let (mut accepted, mut refused) = (Vec::new(), Vec::new());
        let words: Vec<&str> = value.split_whitespace().collect();
        for (k, word) in words.iter().enumerate() {
            let Some(next) = words.get(k + 1) else { continue };
            let above = |bound: f64| bound + 0.5 * bound.abs().max(1.0);
            let below = |bound: f64| bound - 0.5 * bound.abs().max(1.0);
            match (*word, number(next)) {
                (">", Some(bound)) => refused.extend([bound, below(bound)]),
                (">=", Some(bound)) => (accepted.push(bound), refused.push(below(bound))).1,
                ("<", Some(bound)) => refused.extend([bound, above(bound)]),
                ("below", Some(bound)) => refused.extend([bound, above(bound)]),
                ("to", Some(bound)) => (accepted.push(bound), refused.push(above(bound).round())).1,
                _ => {}
            }
            if let ("to", Some(bound)) = (*next, number(word)) {
                accepted.push(bound);
                refused.push(below(bound).floor());
            }
        }
        (accepted, refused)
    }

    /// A template in which the table has `key = number`, in place of the number that the template itself gives.
    fn with_number(template: &str, key: &str, number: f64) -> String {
        let written = |x: f64| if x.fract() == 0.0 { format!("{x:.0}") } else { format!("{x:e}") };
        let start = format!("{key} = ");
        let Some(at) =
            template.rfind(&start).filter(|at| !template[..*at].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
        else {
            return template.replace('@', &format!("{start}{}", written(number)));
        };
        let value = at + start.len();
        let end = template[value..].find([',', '\n', '}']).map_or(template.len(), |length| value + length);
        let own = format!("{}{start}{}{}", &template[..at], written(number), &template[end..]);
        own.replace(", @", "").replace('@', "")
    }

    #[test]
    fn the_stated_bounds_of_numbers_are_those_of_the_reader() {
        let folder = folder();
        let (mut checked, mut wrong) = (0, Vec::new());
        for (table, templates) in SCENES {
            for key in table.keys {
                let (accepted, refused) = bounds(key.value);
                let is_read = |number: f64| {
                    templates
                        .iter()
                        .any(|template| read(folder.path(), &with_number(template, key.name, number), "").is_some())
                };
                for (number, expected) in accepted.iter().map(|x| (x, true)).chain(refused.iter().map(|x| (x, false))) {
                    checked += 1;
                    if is_read(*number) != expected {
                        let what = if expected { "refused" } else { "accepted" };
                        wrong.push(format!("{}: `{} = {number:?}` is {what}", table.heading, key.name));
                    }
                }
            }
        }
        assert!(wrong.is_empty(), "the reader contradicts the descriptions of these keys:\n{}", wrong.join("\n"));
        assert!(checked > 60, "only {checked} bounds were found in the descriptions of values");
    }

    #[test]
    fn tables_and_keys_are_listed_once() {
        let headings: HashSet<&str> = TABLES.iter().map(|table| table.heading).collect();
        assert_eq!(headings.len(), TABLES.len());
        for table in TABLES {
            let names: HashSet<&str> = table.names().into_iter().collect();
            assert_eq!(names.len(), table.keys.len(), "{}: two keys have the same name", table.heading);
            assert!(
                table.keys.iter().all(|key| !key.meaning.is_empty() && !key.value.is_empty()),
                "{}: a key lacks its meaning or the description of its values",
                table.heading
            );
        }
    }
}
