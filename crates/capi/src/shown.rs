//! What a program draws or looks at: skins, copied or shared on the device, and contacts.

use glam::DVec3;
use palpate::internal::step::Skins;
use palpate::{ContactPoint, Simulation};

use super::handles;
use super::simulation::{SimulationObject, palpate_simulation};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};

/// The skins on the device: arrays over the vertices of all bodies, one body's after another's, the tool's last. On a device
/// of the host's the buffers can be bound at once (usage: storage, texel, transfer; positions and normals vertex as well); they
/// live as long as the simulation, unless friction comes into a scene that had none: ask again then, and export again.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_skins {
    /// sizeof(palpate_skins).
    pub size: u32,
    /// Vertices of all skins.
    pub vertex_count: u32,
    /// Triangles of all skins.
    pub triangle_count: u32,
    /// 0.
    pub reserved: u32,
    /// VkBuffer: four floats a vertex, x y z 1, m from the origin.
    pub positions: u64,
    /// VkBuffer: four floats a vertex, unit and outward, and 0.
    pub normals: u64,
    /// VkBuffer: four uint32_t a triangle, its vertices counter-clockwise from outside, and 0.
    pub triangles: u64,
}

// SAFETY: `repr(C)`, the size comes first, and all of it are numbers.
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

/// A colliding skin vertex of the last step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct palpate_contact {
    /// Whose vertex it is, and what it touches: positions in the scene; the tool comes after the bodies.
    pub body: [u32; 2],
    /// The vertex, of its body's skin.
    pub vertex: u32,
    /// 0.
    pub reserved: u32,
    /// Where the vertex is now, world, m.
    pub position: [f64; 3],
    /// Unit, world, out of what is touched.
    pub normal: [f64; 3],
    /// m.
    pub depth: f64,
    /// Skin that it stands for, as seen along the normal, m^2.
    pub area: f64,
    /// Along the normal at the end of the step, Pa: times the area, it is the contact's part of the wrench but for friction. Of
    /// the start of the step after a saved state was taken up.
    pub pressure: f64,
}

/// Of a triangle on the device.
const TRIANGLE_BYTES: u64 = 16;

/// Which array is exported: where skin vertices are.
pub const PALPATE_SKIN_POSITIONS: u32 = 0;
/// Which array is exported: their normals.
pub const PALPATE_SKIN_NORMALS: u32 = 1;

/// Where the skin of a body is, whatever its kind; the tool comes after the bodies. `origin`: three numbers that positions are
/// relative to, m; null: the world's. `positions` and `normals` have room for `capacity` vertices, three floats each (m; unit and
/// outward); either may be null. `count` receives how many there are. PALPATE_STATUS_TOO_SMALL: none was written.
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
        // SAFETY: the caller's, as the header says.
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
                    // SAFETY: the caller's, as the header says.
                    unsafe { sized::copy(&own, to, capacity, name)? };
                }
            }
            Ok(())
        })
    })
}

/// The triangles of a body's skin: three of its vertices each, counter-clockwise from outside; they do not change. `count`
/// receives how many there are; `triangles` has room for `capacity` and may be null where that is 0. PALPATE_STATUS_TOO_SMALL:
/// none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_triangles(
    simulation: *mut palpate_simulation,
    body: u32,
    triangles: *mut [u32; 3],
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let count = unsafe { sized::answer(count, "count")? };
        with(simulation, |simulation| {
            let bodies = simulation.skin_ranges().len();
            if body as usize >= bodies {
                return Err(no_body(body, bodies));
            }
            let all = simulation.skin_triangles(body as usize);
            *count = all.len();
            // SAFETY: the caller's, as the header says.
            if capacity == 0 { Ok(()) } else { unsafe { sized::copy(all, triangles, capacity, "triangles") } }
        })
    })
}

/// Brings the skins on the device up to date, relative to `origin` (three numbers, m; null: the world's), and tells where they
/// are: nothing is copied. The arrays are filled when this returns, and stay until the next call or `palpate_skin`; work of the
/// host's that reads them must be submitted to the same queue, or be done before that. No other call writes to them.
/// The first call makes the arrays.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_buffers(
    simulation: *mut palpate_simulation,
    origin: *const f64,
    skins: *mut palpate_skins,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
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
            // SAFETY: the caller's, as the header says.
            unsafe { sized::tell(skins, &told, "skins") }
        })
    })
}

/// The vertices of a body among those of `palpate_skin_buffers`: the first, and how many. The tool comes after the bodies.
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
            // SAFETY (both): the caller's, as the header says.
            *unsafe { sized::answer(first, "first")? } = range.start as u32;
            *unsafe { sized::answer(count, "count")? } = range.len() as u32;
            Ok(())
        })
    })
}

/// A file descriptor of the memory of one of the arrays of `palpate_skin_buffers` (PALPATE_SKIN_*), for another API to import
/// (VK_KHR_external_memory_fd, opaque; a dedicated allocation that begins with the array), and the size of that memory in
/// bytes. The descriptor is the caller's: what imports it owns it, else close it. Call `palpate_skin_buffers` to bring the
/// array up to date. PALPATE_STATUS_VULKAN: the device cannot.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_skin_export(
    simulation: *mut palpate_simulation,
    which: u32,
    descriptor: *mut i32,
    bytes: *mut u64,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
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

/// The contacts of the last step, as many as its wrench says. `count` receives how many there are; `contacts` has room for `capacity` and may be null where
/// that is 0. PALPATE_STATUS_TOO_SMALL: none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contacts(
    simulation: *mut palpate_simulation,
    contacts: *mut palpate_contact,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let count = unsafe { sized::answer(count, "count")? };
        with(simulation, |simulation| {
            let all: Vec<palpate_contact> = simulation.contacts()?.iter().map(contact_of).collect();
            *count = all.len();
            // SAFETY: the caller's, as the header says.
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
    let problem = format!("body is {body}; the scene has {bodies}, the tool's own counted last, from 0");
    Failure::new(palpate_status::Argument, problem)
}

/// Three finite numbers; null: zero.
///
/// # Safety
/// `origin` is null, or three numbers can be read there.
unsafe fn origin_at(origin: *const f64) -> Outcome<DVec3> {
    // SAFETY: the caller's promise.
    let Some(origin) = (unsafe { sized::given(origin.cast::<[f64; 3]>(), "origin")? }) else { return Ok(DVec3::ZERO) };
    let origin = DVec3::from_array(*origin);
    match origin.is_finite() {
        true => Ok(origin),
        false => Err(Failure::new(palpate_status::Argument, format!("origin is {origin}; give numbers"))),
    }
}
