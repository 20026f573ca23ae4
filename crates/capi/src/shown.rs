//! Data that a program draws or inspects: the skins (surface meshes) of the bodies, copied or as arrays on the GPU, and
//! the contacts of the last step.

use glam::DVec3;
use palpate::internal::step::Skins;
use palpate::{ContactPoint, Simulation};

use super::handles;
use super::simulation::{SimulationObject, palpate_simulation};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// The skins as arrays on the Vulkan device: the vertices of all bodies one after another, the tool's last. On a device
/// that the program itself opened, the buffers can be bound directly (usages: storage, texel and transfer; positions
/// and normals also vertex). They live as long as the simulation, except that they are replaced when
/// palpate_contact_set switches friction on in a scene that had none: after that, get them again, and export them
/// again.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_skins {
    /// Size of the struct in bytes: sizeof(palpate_skins).
    pub size: u32,
    /// Number of vertices of all skins.
    pub vertex_count: u32,
    /// Number of triangles of all skins.
    pub triangle_count: u32,
    /// Reserved: always 0.
    pub reserved: u32,
    /// VkBuffer of the vertex positions: four floats per vertex, x y z 1, in m relative to the `origin` of the call.
    pub positions: u64,
    /// VkBuffer of the vertex normals: four floats per vertex, a unit outward vector and 0.
    pub normals: u64,
    /// VkBuffer of the triangles: four uint32_t per triangle, its three vertices counter-clockwise seen from outside,
    /// and 0.
    pub triangles: u64,
}

// SAFETY: it is `repr(C)`, its first field is the size, and all fields are numbers: any bytes are a value.
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

/// A contact of the last step: a skin vertex of one body inside another.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct palpate_contact {
    /// The body to which the vertex belongs, and the body that it touches, by their positions in the scene; the tool
    /// comes after the bodies.
    pub body: [u32; 2],
    /// Index of the vertex in its body's skin.
    pub vertex: u32,
    /// Reserved: always 0.
    pub reserved: u32,
    /// World position of the vertex now, m.
    pub position: [f64; 3],
    /// Contact normal: unit vector in world axes, outward from the touched body.
    pub normal: [f64; 3],
    /// Penetration depth along the normal, m.
    pub depth: f64,
    /// Area of the part of the skin that belongs to the vertex, projected along the normal, m^2.
    pub area: f64,
    /// Contact pressure along the normal at the end of the step, Pa. `pressure` times `area` is the normal force of
    /// this contact on the tool, a part of the wrench's force. If a state was restored since the last step, this is the
    /// pressure at the start of that step instead.
    pub pressure: f64,
}

/// Size of a triangle in the array on the Vulkan device, bytes.
const TRIANGLE_BYTES: u64 = 16;

/// Array for palpate_skin_export: the positions of skin vertices.
pub const PALPATE_SKIN_POSITIONS: u32 = 0;
/// Array for palpate_skin_export: the normals of skin vertices.
pub const PALPATE_SKIN_NORMALS: u32 = 1;

/// Copies the skin of a body of any kind; the tool comes after the bodies. `origin`: three coordinates to which
/// positions are relative, m; null: the world's origin. `positions` (m) and `normals` (unit, outward) have room for
/// `capacity` vertices, three floats each; either may be null. `count` receives the number of vertices.
/// PALPATE_STATUS_TOO_SMALL: there are more than `capacity`, and none was written.
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

/// Copies the triangles of a body's skin: three vertex indices per triangle, counter-clockwise seen from outside. They
/// never change. `count` receives their number; `triangles` has room for `capacity` of them, and may be null where
/// `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more than `capacity`, and none was written.
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
            *count = all.len();
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            if capacity == 0 { Ok(()) } else { unsafe { sized::copy(all, triangles, capacity, "triangles") } }
        })
    })
}

/// Computes the skins on the Vulkan device as they are now, relative to `origin` (three coordinates, m; null: the
/// world's origin), and returns their buffers; nothing is copied. The arrays are filled when this returns, and keep
/// their contents until the next call of this function or of `palpate_skin`; no other call writes to them. GPU work of
/// the program that reads the arrays must be submitted to the same queue, or be finished before such a call. The first
/// call makes the arrays.
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

/// Reads which vertices in the arrays of `palpate_skin_buffers` are a body's: the index of the first, and their number.
/// The tool comes after the bodies.
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
            // SAFETY (both blocks): the C caller keeps the rules for pointers at the top of palpate.h.
            *unsafe { sized::answer(first, "first")? } = range.start as u32;
            *unsafe { sized::answer(count, "count")? } = range.len() as u32;
            Ok(())
        })
    })
}

/// Exports the memory of one of the arrays of `palpate_skin_buffers` (PALPATE_SKIN_*) as a file descriptor that another
/// API can import (VK_KHR_external_memory_fd, an opaque descriptor of a dedicated allocation, at the start of which the
/// array lies), with the size of that memory in bytes. The caller owns the descriptor: a successful import takes it
/// over, otherwise the caller must close it. Call `palpate_skin_buffers` to update the array. PALPATE_STATUS_VULKAN:
/// the device cannot export.
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

/// Copies the contacts of the last step, as many as the field `contacts` of that step's wrench. `count` receives their
/// number; `contacts` has room for `capacity` of them, and may be null where `capacity` is 0. PALPATE_STATUS_TOO_SMALL:
/// there are more than `capacity`, and none was written.
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
            *count = all.len();
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            if capacity == 0 { Ok(()) } else { unsafe { sized::copy(&all, contacts, capacity, "contacts") } }
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

/// Reads three finite coordinates; null: zero.
///
/// # Safety
/// `origin` is null, or three numbers can be read there.
unsafe fn origin_at(origin: *const f64) -> Outcome<DVec3> {
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let Some(origin) = (unsafe { sized::given(origin.cast::<[f64; 3]>(), "origin")? }) else { return Ok(DVec3::ZERO) };
    let origin = DVec3::from_array(*origin);
    match origin.is_finite() {
        true => Ok(origin),
        false => Err(Failure::new(palpate_status::Argument, format!("origin is {origin}; give finite numbers"))),
    }
}
