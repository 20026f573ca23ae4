//! Turns the structs of `describe.rs`, by which a C program describes a scene, into the tables of a scene file (TOML).
//! Fields that are zero or null are left out; most values are checked later, by the code that checks scene files. The
//! layer of a soft body is its tetrahedral mesh; a rigid core is a rigid body inside a soft one, to which nodes of the
//! layer are attached; the tool is the rigid body that the haptic device leads, by the spring and damper of the virtual
//! coupling.

use toml::{Table, Value};

use super::describe::{palpate_body, palpate_core, palpate_key, palpate_settings, palpate_tool};
use super::sized::{self, Sized32};
use super::status::{Failure, Outcome, palpate_status};

const MOTIONS: [&str; 3] = ["fixed", "driven", "dynamic"];
const LAWS: [&str; 2] = ["corotational", "neo-hookean"];
const DILATATIONS: [&str; 2] = ["element", "patch"];

/// Makes the tables `[step]`, `[solver]` and `[contact]` of a scene from its settings.
pub(super) fn of_settings(given: &palpate_settings) -> Outcome<Table> {
    let [mut step, mut solver, mut contact] = [Table::new(), Table::new(), Table::new()];
    number(&mut step, "dt", given.dt);
    count(&mut step, "newton", given.newton);
    if truth::<palpate_settings>("weightless", given.weightless)? {
        if given.gravity != [0.0; 3] {
            return Err(wrong::<palpate_settings>(
                "weightless is 1, but gravity is not zero; set weightless or gravity to zero",
            ));
        }
        step.insert("gravity".into(), vec![0.0; 3].into());
    }
    vector(&mut step, "gravity", &given.gravity);
    count(&mut solver, "max_iterations", given.max_iterations);
    number(&mut solver, "tolerance", given.tolerance);
    number(&mut contact, "stiffness", given.contact_stiffness);
    number(&mut contact, "damping", given.contact_damping);
    number(&mut contact, "friction", given.friction);
    number(&mut contact, "friction_speed", given.friction_speed);
    number(&mut contact, "depth_limit", given.depth_limit);
    Ok([("step", step), ("solver", solver), ("contact", contact)]
        .map(|(key, t)| (key.into(), t.into()))
        .into_iter()
        .collect())
}

/// Makes a table `[[body]]` of a scene.
///
/// # Safety
/// The pointers in the struct are null, or fulfil the conditions in the comment at the top of palpate.h.
pub(super) unsafe fn of_body(given: &palpate_body) -> Outcome<Table> {
    let mut body = Table::new();
    if given.reserved != 0 {
        return Err(wrong::<palpate_body>(format!("reserved is {}; set it to 0", given.reserved)));
    }
    // SAFETY (all calls in this block): the caller keeps the conditions under `# Safety`.
    unsafe {
        body.insert("name".into(), sized::string(given.name, "palpate_body.name")?.into());
        mesh(&mut body, "surface", given.surface, "palpate_body.surface")?;
        layer(&mut body, given)?;
        moves::<palpate_body>(&mut body, given.motion, given.mass, given.keys, given.key_count)?;
        let cores = sized::structs(given.cores, given.core_count, "palpate_body.cores")?;
        let cores: Vec<Table> = cores.iter().map(|core| of_core(core)).collect::<Outcome<_>>()?;
        if !cores.is_empty() {
            body.insert("core".into(), cores.into());
        }
    }
    let mut material = Table::new();
    number(&mut material, "young", given.young);
    number(&mut material, "density", given.density);
    number(&mut material, "damping_mass", given.damping_mass);
    number(&mut material, "damping_stiffness", given.damping_stiffness);
    choice::<palpate_body>(&mut material, "law", given.law, &LAWS)?;
    if !material.is_empty() || given.poisson != 0.0 {
        material.insert("poisson".into(), given.poisson.into());
        body.insert("material".into(), material.into());
    }
    choice::<palpate_body>(&mut body, "dilatation", given.dilatation, &DILATATIONS)?;
    vector(&mut body, "plane", &given.plane);
    number(&mut body, "scale", given.scale);
    vector(&mut body, "position", &given.position);
    vector(&mut body, "orientation", &given.orientation);
    vector(&mut body, "velocity", &given.velocity);
    count(&mut body, "hulls", given.hulls);
    repair::<palpate_body>(&mut body, given.strict)?;
    Ok([("body".into(), vec![body].into())].into_iter().collect())
}

/// Inserts the key `layer = { .. }` into the table of a body, unless the struct describes no layer.
///
/// # Safety
/// The pointers in the struct fulfil the conditions of [`of_body`].
unsafe fn layer(body: &mut Table, given: &palpate_body) -> Outcome {
    let mut layer = Table::new();
    number(&mut layer, "cell", given.cell);
    count(&mut layer, "across", given.across);
    count(&mut layer, "grade", given.grade);
    number(&mut layer, "thickness", given.thickness);
    corners(&mut layer, given.box_low, given.box_high);
    if given.box_cells != [0; 3] {
        layer.insert("cells".into(), given.box_cells.map(i64::from).to_vec().into());
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    unsafe { mesh(body, "layer", given.layer, "palpate_body.layer")? };
    match body.get_mut("layer").and_then(Value::as_table_mut) {
        Some(table) => table.extend(layer),
        None if layer.is_empty() => {}
        None => drop(body.insert("layer".into(), layer.into())),
    }
    Ok(())
}

/// Makes a table `[[body.core]]`, which describes a rigid core of a body.
///
/// # Safety
/// The pointers in the struct fulfil the conditions of [`of_body`].
unsafe fn of_core(given: &palpate_core) -> Outcome<Table> {
    if given.reserved != 0 {
        return Err(wrong::<palpate_core>(format!("reserved is {}; set it to 0", given.reserved)));
    }
    let [mut core, mut bind] = [Table::new(), Table::new()];
    number(&mut bind, "inset", given.inset);
    corners(&mut bind, given.box_low, given.box_high);
    let [x, y, z] = given.sphere_centre;
    vector(&mut bind, "sphere", &[x, y, z, given.sphere_radius]);
    if truth::<palpate_core>("all", given.all)? {
        bind.insert("all".into(), true.into());
    }
    // SAFETY (all calls in this block): the caller keeps the conditions under `# Safety`.
    unsafe {
        core.insert("name".into(), sized::string(given.name, "palpate_core.name")?.into());
        moves::<palpate_core>(&mut core, given.motion, given.mass, given.keys, given.key_count)?;
        let nodes = sized::array(given.nodes, given.node_count, "palpate_core.nodes")?;
        if !nodes.is_empty() {
            bind.insert("nodes".into(), nodes.iter().map(|&node| i64::from(node)).collect::<Vec<_>>().into());
        }
    }
    if !bind.is_empty() {
        core.insert("bind".into(), bind.into());
    }
    Ok(core)
}

/// Makes the tables `[tool]` and, if the struct describes a virtual coupling, `[coupling]`.
///
/// # Safety
/// The pointers in the struct are null, or fulfil the conditions in the comment at the top of palpate.h.
pub(super) unsafe fn of_tool(given: &palpate_tool) -> Outcome<Table> {
    let mut tool = Table::new();
    number(&mut tool, "sphere", given.sphere);
    // SAFETY (both calls in this block): the caller keeps the conditions under `# Safety`.
    unsafe {
        mesh(&mut tool, "surface", given.surface, "palpate_tool.surface")?;
        if !given.body.is_null() {
            tool.insert("body".into(), sized::string(given.body, "palpate_tool.body")?.into());
        }
    }
    number(&mut tool, "mass", given.mass);
    vector(&mut tool, "position", &given.position);
    vector(&mut tool, "orientation", &given.orientation);
    vector(&mut tool, "velocity", &given.velocity);
    number(&mut tool, "scale", given.scale);
    repair::<palpate_tool>(&mut tool, given.strict)?;
    let springs = [
        ("stiffness", given.stiffness),
        ("damping", given.damping),
        ("angular_stiffness", given.angular_stiffness),
        ("angular_damping", given.angular_damping),
    ];
    let mut tables: Table = [("tool".into(), tool.into())].into_iter().collect();
    if springs.iter().any(|(_, x)| *x != 0.0) {
        let coupling: Table = springs.map(|(key, x)| (key.into(), x.into())).into_iter().collect();
        tables.insert("coupling".into(), coupling.into());
    }
    Ok(tables)
}

/// Inserts the keys `motion`, `mass` and `keys` into the table of a body or of a rigid core. In error messages the name
/// of the struct `T` stands before the name of a field. `keys` are `many` keyframes of the motion.
///
/// # Safety
/// `keys` is null, or leads to `many` keyframes.
unsafe fn moves<T: Sized32>(
    table: &mut Table,
    motion: u32,
    mass: f64,
    keys: *const palpate_key,
    many: usize,
) -> Outcome {
    choice::<T>(table, "motion", motion, &MOTIONS)?;
    number(table, "mass", mass);
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let keys = unsafe { sized::array(keys, many, &format!("{}.keys", T::NAME))? };
    let key = |key: &palpate_key| {
        let place = [&[key.time][..], &key.pose.position].concat();
        let turned = key.pose.orientation != [0.0; 4];
        Value::from(if turned { [&place[..], &key.pose.orientation].concat() } else { place })
    };
    if !keys.is_empty() {
        table.insert("keys".into(), keys.iter().map(key).collect::<Vec<_>>().into());
    }
    Ok(())
}

fn wrong<T: Sized32>(what: impl AsRef<str>) -> Failure {
    Failure::new(palpate_status::Argument, format!("{}.{}", T::NAME, what.as_ref()))
}

/// Inserts under `key` the name with the index `given` in `names`; the name with index 0 is the default and is left
/// out.
fn choice<T: Sized32>(table: &mut Table, key: &str, given: u32, names: &[&str]) -> Outcome {
    let name = names.get(given as usize).ok_or_else(|| {
        wrong::<T>(format!("{key} is {given}; give a PALPATE_{}_* of 0 to {}", key.to_uppercase(), names.len() - 1))
    })?;
    if given != 0 {
        table.insert(key.into(), (*name).into());
    }
    Ok(())
}

fn truth<T: Sized32>(key: &str, given: u32) -> Outcome<bool> {
    match given {
        0 | 1 => Ok(given == 1),
        _ => Err(wrong::<T>(format!("{key} is {given}; give 0 or 1"))),
    }
}

fn repair<T: Sized32>(table: &mut Table, strict: u32) -> Outcome {
    if truth::<T>("strict", strict)? {
        table.insert("repair".into(), false.into());
    }
    Ok(())
}

/// Inserts a number unless it is 0. NaN is inserted too, so that the later check of the tables refuses it.
fn number(table: &mut Table, key: &str, given: f64) {
    if given != 0.0 {
        table.insert(key.into(), given.into());
    }
}

fn count(table: &mut Table, key: &str, given: u32) {
    if given != 0 {
        table.insert(key.into(), i64::from(given).into());
    }
}

fn vector(table: &mut Table, key: &str, given: &[f64]) {
    if given.iter().any(|x| *x != 0.0) {
        table.insert(key.into(), given.to_vec().into());
    }
}

fn corners(table: &mut Table, low: [f64; 3], high: [f64; 3]) {
    if low != [0.0; 3] || high != [0.0; 3] {
        table.insert("box".into(), vec![low.to_vec(), high.to_vec()].into());
    }
}

/// Inserts `{ mesh = "name" }` under `key`, unless the name is null. Error messages call the name `argument`.
///
/// # Safety
/// `name` is null, or leads to a string that is terminated by a zero byte.
unsafe fn mesh(table: &mut Table, key: &str, name: *const std::ffi::c_char, argument: &str) -> Outcome {
    if !name.is_null() {
        // SAFETY: the caller keeps the conditions under `# Safety`.
        let name = unsafe { sized::string(name, argument)? };
        let mesh: Table = [("mesh".into(), name.into())].into_iter().collect();
        table.insert(key.into(), mesh.into());
    }
    Ok(())
}
