//! Functions that give a program data to draw or inspect: the skins (surface meshes) of the bodies, as copies or as
//! arrays on the GPU, and the contacts of the last step. The skin of the tool (the rigid body that the haptic device
//! leads) comes after those of the bodies.

use glam::DVec3;
use palpate::internal::step::Skins;
use palpate::{ContactPoint, Simulation};

use super::handles;
use super::simulation::{SimulationObject, palpate_simulation};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// The skins (surface meshes) as arrays on the Vulkan device: the vertices of all bodies one after another, those of
/// the tool last. If the program itself opened the device, it can bind the buffers directly (usages: storage, texel and
/// transfer; positions and normals also vertex). The buffers live as long as the simulation, with one exception: when
/// palpate_contact_set switches friction on in a scene without friction, new buffers replace them, and the program must
/// get the buffers again and export them again.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_skins {
    /// Size of the struct in bytes: sizeof(palpate_skins).
    pub size: u32,
    /// Number of the vertices of all skins together.
    pub vertex_count: u32,
    /// Number of the triangles of all skins together.
    pub triangle_count: u32,
    /// Reserved: always 0.
    pub reserved: u32,
    /// VkBuffer of the vertex positions: four floats per vertex, x, y, z (m, relative to the `origin` passed to
    /// palpate_skin_buffers) and 1.
    pub positions: u64,
    /// VkBuffer of the vertex normals: four floats per vertex, the three components of a unit outward vector and 0.
    pub normals: u64,
    /// VkBuffer of the triangles: four uint32_t per triangle, the indices of its three vertices counter-clockwise seen
    /// from outside, and 0.
    pub triangles: u64,
}

// SAFETY: the struct is `repr(C)`, its first field is its size, and all fields are numbers, so any bytes are a value.
unsafe impl Sized32 for palpate_skins {
    const NAME: &str = "palpate_skins";
    const LEAST: usize = 40;
    const FIELDS: &'static [Field] =
        fields!(palpate_skins { size, vertex_count, triangle_count, reserved, positions, normals, triangles });

    fn unset() -> Self {
        let size = size_of::<Self>() as u32;
        palpate_skins { size, vertex_count: 0, triangle_count: 0, reserved: 0, positions: 0, normals: 0, triangles: 0 }
    }
}

/// A contact of the last step: a vertex of one body's skin that lies inside another body, or the part of a triangle that
/// does, where triangles are tested for contact (scene key `contact.samples`).
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct palpate_contact {
    /// First the body to which the vertex or triangle belongs, then the body inside which it lies, both by their positions
    /// in the scene, counted from 0; the tool is counted after the last body.
    pub body: [u32; 2],
    /// Index of the vertex in its body's skin; of a triangle, the corner nearest to its centre of pressure.
    pub vertex: u32,
    /// Reserved: always 0.
    pub reserved: u32,
    /// World position of the vertex, or of the triangle's centre of pressure, at the time of the call, m.
    pub position: [f64; 3],
    /// Contact normal: unit vector in world axes, outward from the body inside which the vertex lies.
    pub normal: [f64; 3],
    /// Penetration depth along the normal, m; of a triangle, the mean over its part.
    pub depth: f64,
    /// Area of the vertex's share of the skin, or of the triangle's part, projected along the contact normal, m^2.
    pub area: f64,
    /// Contact pressure along the normal at the end of the step, Pa. `pressure` times `area` is the magnitude of the
    /// normal force of this contact; if one of the bodies is the tool, this force is a part of the net force in
    /// palpate_wrench. If a state was restored since the last step, `pressure` is instead that at the start of the
    /// step.
    pub pressure: f64,
}

/// Size of one triangle in the array on the Vulkan device, bytes.
const TRIANGLE_BYTES: u64 = 16;

/// The array that palpate_skin_export exports: the positions of skin vertices.
pub const PALPATE_SKIN_POSITIONS: u32 = 0;
/// The array that palpate_skin_export exports: the normals of skin vertices.
pub const PALPATE_SKIN_NORMALS: u32 = 1;

/// Copies the skin (surface mesh) of a body of any kind. `body`: position of the body in the scene, from 0; the tool is
/// counted after the last body. `origin`: the world point to which positions are relative, three coordinates, m; null:
/// the world's origin. `positions` (m) and `normals` (unit vectors, outward) have room for `capacity` vertices, three
/// floats each; either may be null. `count` receives the number of vertices. PALPATE_STATUS_TOO_SMALL: there are more
/// vertices than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin(
    simulation: *mut palpate_simulation,
    body: u32,
    origin: *const f64,
    positions: *mut [f32; 3],
    normals: *mut [f32; 3],
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (count, origin) = unsafe { (sized::answer(count, "count")?, origin_at(origin)?) };
        with(simulation, |simulation| {
            let ranges = simulation.skin_ranges();
            let range = ranges.get(body as usize).cloned().ok_or_else(|| no_body(body, ranges.len()))?;
            *count = range.len();
            if capacity == 0 || (positions.is_null() && normals.is_null()) {
                return Ok(());
            }
            let skins = simulation.skins(origin)?;
            for (array, to, name) in [(skins.positions, positions, "positions"), (skins.normals, normals, "normals")] {
                if !to.is_null() {
                    let all = array.read::<[f32; 4]>()?;
                    let own: Vec<[f32; 3]> = all[range.clone()].iter().map(|[x, y, z, _]| [*x, *y, *z]).collect();
                    // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
                    unsafe { sized::copy(&own, to, capacity, name)? };
                }
            }
            Ok(())
        })
    })
}

/// Copies the force of the last step's contacts on each vertex of a body's skin, N, world axes, in the order of the skin.
/// A contact acts on the vertex that it is found at, and with the opposite force on the corners of the triangle that the
/// vertex has met; or, where triangles are tested for contact, on the corners of the triangle and on no vertex of the
/// rigid body that it meets. `body` is the body's position in the scene, from 0; the tool is counted after the last body.
/// `count` receives the number of vertices; `forces` has room for `capacity` of them, and may be null if `capacity` is 0.
/// PALPATE_STATUS_TOO_SMALL: there are more vertices than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_forces(
    simulation: *mut palpate_simulation,
    body: u32,
    forces: *mut [f64; 3],
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        with(simulation, |simulation| {
            let ranges = simulation.skin_ranges();
            *count = ranges.get(body as usize).ok_or_else(|| no_body(body, ranges.len()))?.len();
            if capacity == 0 {
                return Ok(());
            }
            let all: Vec<[f64; 3]> =
                simulation.contact_forces(body as usize)?.iter().map(|force| force.to_array()).collect();
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::copy(&all, forces, capacity, "forces") }
        })
    })
}

/// Copies the triangles of a body's skin: three vertex indices per triangle, counter-clockwise seen from outside. The
/// triangles never change. `count` receives their number; `triangles` has room for `capacity` triangles, and may be
/// null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more triangles than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_triangles(
    simulation: *mut palpate_simulation,
    body: u32,
    triangles: *mut [u32; 3],
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        with(simulation, |simulation| {
            let bodies = simulation.skin_ranges().len();
            if body as usize >= bodies {
                return Err(no_body(body, bodies));
            }
            let all = simulation.skin_triangles(body as usize);
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::list(all, triangles, capacity, count, "triangles") }
        })
    })
}

/// Computes the present skins on the Vulkan device, relative to the world point `origin` (three coordinates, m; null:
/// the world's origin), and writes their buffers to `skins`; nothing is copied from the GPU. When the call returns, the
/// arrays are filled; they keep their contents until the next call of this function or of `palpate_skin`, and no other
/// function writes to them. GPU work of the program that reads the arrays must be submitted to the queue that the
/// library uses, or must be finished before the next call of one of these two functions. The first call makes the
/// arrays.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_buffers(
    simulation: *mut palpate_simulation,
    origin: *const f64,
    skins: *mut palpate_skins,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let origin = unsafe { origin_at(origin)? };
        with(simulation, |simulation| {
            let vertices = simulation.skin_ranges().last().map_or(0, |last| last.end);
            let Skins { positions, normals, triangles } = simulation.skins(origin)?;
            let told = palpate_skins {
                vertex_count: vertices as u32,
                triangle_count: if vertices > 0 { (triangles.bytes() / TRIANGLE_BYTES) as u32 } else { 0 },
                positions: positions.raw(),
                normals: normals.raw(),
                triangles: triangles.raw(),
                ..palpate_skins::unset()
            };
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::tell(skins, &told, "skins") }
        })
    })
}

/// Reads which vertices in the arrays of `palpate_skin_buffers` belong to a body. `first` receives the index of the
/// first vertex, and `count` the number of vertices. The tool is counted after the last body.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_range(
    simulation: *mut palpate_simulation,
    body: u32,
    first: *mut u32,
    count: *mut u32,
) -> palpate_status {
    guarded(|| {
        with(simulation, |simulation| {
            let ranges = simulation.skin_ranges();
            let range = ranges.get(body as usize).ok_or_else(|| no_body(body, ranges.len()))?;
            // SAFETY (here and in the next line): the C caller keeps the rules for pointers at the top of palpate.h.
            *unsafe { sized::answer(first, "first")? } = range.start as u32;
            *unsafe { sized::answer(count, "count")? } = range.len() as u32;
            Ok(())
        })
    })
}

/// Exports the memory of one of the arrays of `palpate_skin_buffers`, for import by another API. `which`: the array,
/// PALPATE_SKIN_*. `descriptor` receives an opaque file descriptor (VK_KHR_external_memory_fd) of a dedicated
/// allocation, at the start of which the array lies; `bytes` receives the size of that allocation. The caller owns the
/// descriptor: a successful import takes it over, otherwise the caller must close it. The contents of the array change
/// only when `palpate_skin_buffers` or `palpate_skin` is called. PALPATE_STATUS_VULKAN: the device cannot export
/// memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_export(
    simulation: *mut palpate_simulation,
    which: u32,
    descriptor: *mut i32,
    bytes: *mut u64,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let (descriptor, bytes) = unsafe { (sized::answer(descriptor, "descriptor")?, sized::answer(bytes, "bytes")?) };
        (*descriptor, *bytes) = (-1, 0);
        if which > PALPATE_SKIN_NORMALS {
            let problem = format!("which is {which}; give one of PALPATE_SKIN_*");
            return Err(Failure::new(palpate_status::Argument, problem));
        }
        with(simulation, |simulation| {
            if !simulation.context().shares_memory() {
                let problem =
                    "the device has no VK_KHR_external_memory_fd, or it is not enabled; copy with palpate_skin";
                return Err(Failure::new(palpate_status::Vulkan, problem));
            }
            let skins = simulation.skin_arrays()?;
            let array = if which == PALPATE_SKIN_POSITIONS { skins.positions } else { skins.normals };
            (*descriptor, *bytes) = array.export()?;
            Ok(())
        })
    })
}

/// Copies the contacts of the last step, whose number is also the field `contacts` of that step's palpate_wrench.
/// `count` receives their number; `contacts` has room for `capacity` contacts, and may be null if `capacity` is 0.
/// PALPATE_STATUS_TOO_SMALL: there are more contacts than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contacts(
    simulation: *mut palpate_simulation,
    contacts: *mut palpate_contact,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        with(simulation, |simulation| {
            let all: Vec<palpate_contact> = simulation.contacts()?.iter().map(contact_of).collect();
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::list(&all, contacts, capacity, count, "contacts") }
        })
    })
}

fn contact_of(point: &ContactPoint) -> palpate_contact {
    palpate_contact {
        body: point.bodies.map(|body| body as u32),
        vertex: point.vertex as u32,
        reserved: 0,
        position: point.position.to_array(),
        normal: point.normal.to_array(),
        depth: point.depth,
        area: point.area,
        pressure: point.pressure,
    }
}

fn with<R>(simulation: *mut palpate_simulation, work: impl FnOnce(&mut Simulation) -> Outcome<R>) -> Outcome<R> {
    handles::with(simulation as usize, |object: &mut SimulationObject| work(&mut object.simulation))
}

fn no_body(body: u32, bodies: usize) -> Failure {
    let problem = format!("body is {body}; the scene has {bodies} bodies, counted from 0, with the tool as the last");
    Failure::new(palpate_status::Argument, problem)
}

/// Reads a point, three finite coordinates; if the pointer is null, the point is zero.
///
/// # Safety
/// `origin` is null, or three numbers can be read at this address.
unsafe fn origin_at(origin: *const f64) -> Outcome<DVec3> {
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let Some(origin) = (unsafe { sized::given(origin.cast::<[f64; 3]>(), "origin")? }) else { return Ok(DVec3::ZERO) };
    let origin = DVec3::from_array(*origin);
    match origin.is_finite() {
        true => Ok(origin),
        false => Err(Failure::new(palpate_status::Argument, format!("origin is {origin}; give finite numbers"))),
    }
}
