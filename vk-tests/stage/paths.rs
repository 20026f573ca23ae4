//! The stage depth finds ray hits (triangles that the rays of skin vertices meet), and has two paths (implementations):
//! compute and graphics. The tests compare the two paths: ray hits, contacts, forces and step reports must be the same
//! to the last bit. A contact patch is a place where a pair of bodies may touch.

use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use palpate::internal::gpu::Recorder;
use palpate::internal::prepare::{self, Body, sphere};
use palpate::internal::shaders::{ContactPatch, Counts, Frame, Link, NONE, Pair, StepParams};
use palpate::internal::stages::CHUNK_VERTICES;
use palpate::internal::stages::Common;
use palpate::internal::stages::contact::Contact;
use palpate::internal::stages::cull::{Cull, MOST_CELLS};
use palpate::internal::stages::depth::{Depth, Path};
use palpate::internal::stages::elastic::Elastic;
use palpate::internal::stages::model::Model;
use palpate::internal::stages::pose::Pose;
use palpate::internal::stages::skin::Skin;
use palpate::internal::step::frames::Frames;
use palpate::scene::Samples;
use palpate::{Flags, Scene, Simulation, StepReport};

use crate::harness::random::Random;
use crate::harness::{assert_clean, context};
use crate::scene::whole_step::{open, run, scene};

const PATHS: [Path; 2] = [Path::Compute, Path::Graphics];

/// A step report as bits, without the wall time.
fn bits(row: &StepReport) -> Vec<u64> {
    let tool = row.tool.unwrap();
    let vectors = [tool.tool.position, tool.force, tool.torque];
    let mut all: Vec<f64> = vectors.iter().flat_map(|v| v.to_array()).collect();
    all.extend(tool.tool.orientation.to_array());
    all.extend([row.residual, row.max_depth.unwrap()]);
    all.extend(row.probes.iter().flat_map(|p| p.to_array()));
    let counts = [row.step, row.contacts.unwrap().into(), row.iterations.into(), row.flags.0.into()];
    all.iter().map(|x| x.to_bits()).chain(counts).collect()
}

/// Runs a scene on both paths, step by step, and compares step reports, contact patches and contacts.
fn judge(name: &str, scene: &Scene, steps: usize) {
    let mut simulations = PATHS.map(|path| open(scene, Some(path)));
    let (mut contacts, mut force) = (0, 0.0f64);
    for step in 0..steps {
        let rows = simulations.each_mut().map(|simulation| run(simulation, 1).remove(0));
        assert_eq!(bits(&rows[0]), bits(&rows[1]), "{name}, step {step}: step reports of both paths {rows:#?}");
        let touches = simulations.each_ref().map(|s: &Simulation| {
            let (contact_patches, contacts) = s.touch().unwrap();
            (
                bytemuck::cast_slice::<_, u32>(&contact_patches).to_vec(),
                bytemuck::cast_slice::<_, u32>(&contacts).to_vec(),
            )
        });
        assert!(touches[0] == touches[1], "{name}, step {step}: contacts of both paths differ");
        contacts = contacts.max(rows[0].contacts.unwrap());
        force = force.max(rows[0].tool.unwrap().force.length());
    }
    for (simulation, path) in simulations.iter().zip(PATHS) {
        let depth = simulation.plan().entries.iter().find(|entry| entry.stage == "depth").unwrap();
        assert!(
            depth.reason == format!("{} path: asked for", path.name()),
            "reason for the depth path: {}",
            depth.reason
        );
    }
    println!("{name}: up to {contacts} contacts and {force:.2} N, identical on both paths");
    assert!(
        contacts > 20 && force > 0.1,
        "{name}: {contacts} contacts, expected more than 20; force {force} N, expected more than 0.1 N"
    );
}

#[test]
#[ignore = "long: 6 s"]
fn a_press_into_a_head_is_the_same_by_both_paths() {
    judge(
        "head",
        &scene(
            "[[body]]\nname = \"head\"\nsurface = { model = \"head\", vertices = 8000 }\nlayer = { cell = 0.03 }\n\
             material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }\n\
             [[body.core]]\nname = \"skull\"\nmotion = \"fixed\"\nbind = { inset = 0.04 }\n\
             [tool]\nsphere = 0.015\nmass = 0.05\nposition = [0.03, -0.02, 0.097]\n\
             [coupling]\nstiffness = 500.0\ndamping = 5.0\nangular_stiffness = 0.5\nangular_damping = 0.002\n\
             [drive]\nkeys = [[0.0, 0.03, -0.02, 0.097], [0.05, 0.02, -0.015, 0.082]]\n\
             [[probe]]\nname = \"cheek\"\nbody = \"head\"\nnearest = [0.03, -0.02, 0.08]\n",
        ),
        50,
    );
}

#[test]
#[ignore = "long: 5 s"]
fn soft_balls_under_a_tool_are_the_same_by_both_paths() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ball.obj");
    let (vertices, triangles) = sphere::icosphere(0.05);
    palpate::scene::obj::write(&mut std::fs::File::create(&file).unwrap(), &vertices, &triangles).unwrap();
    let ball = |name: &str, y: f64, core: &str| {
        format!(
            "[[body]]\nname = \"{name}\"\nsurface = {file:?}\nlayer = {{ across = 6 }}\nposition = [0.0, {y}, 0.0]\n\
             material = {{ young = 2e4, poisson = 0.45, density = 1000.0 }}\n{core}"
        )
    };
    let held = "[[body.core]]\nname = \"core\"\nmotion = \"fixed\"\nbind = { inset = 0.03 }\n";
    judge(
        "balls",
        &scene(&format!(
            "{}{}[tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.168, 0.0]\n\
             [coupling]\nstiffness = 500.0\ndamping = 5.0\n\
             [drive]\nkeys = [[0.0, 0.0, 0.168, 0.0], [0.04, 0.004, 0.15, 0.0]]\n",
            ball("below", 0.0, held),
            ball("above", 0.099, "")
        )),
        50,
    );
}

/// The stages of a step up to stage depth, on both paths, for rigid bodies and a tool.
struct Query {
    common: Common,
    cull: Cull,
    skin: Skin,
    depths: [Depth; 2],
    recordings: [palpate::internal::gpu::Recording; 2],
    model: Model,
    scene: Scene,
}

impl Query {
    fn new(bodies: &[Body], tool: &Body) -> Query {
        let (context, mut scene) = (context(), Scene::empty("two bodies"));
        scene.contact.samples = Samples::Vertices;
        let model = Model::new(&scene, bodies, Some(tool));
        let common = Common::new(context, &model).unwrap();
        let (elastic, pose) = (Elastic::new(context, &model).unwrap(), Pose::new(context, &model).unwrap());
        let (cull, skin) = (Cull::new(context, &model, true).unwrap(), Skin::new(context, &model).unwrap());
        let contact = Contact::new(context, &model, true, true).unwrap();
        let depths = PATHS.map(|path| Depth::new(context, &model, path).unwrap());
        let recordings = depths.each_ref().map(|depth| {
            let mut recorder = Recorder::new(context).unwrap();
            skin.record_clear(&mut recorder);
            pose.record(&mut recorder, &common, &elastic);
            cull.record(&mut recorder, &common, &pose, &contact, &elastic);
            skin.record(&mut recorder, &common, &pose, &cull, &elastic);
            depth.record(&mut recorder, &common, &cull, &skin);
            recorder.finish().unwrap()
        });
        Query { common, cull, skin, depths, recordings, model, scene }
    }

    /// The hits that one path finds on the ray of each vertex in the spatial hash. A hit is four words: 2 * patch +
    /// side of the vertex, triangle, bits of the depth, and the triangle's work item (group of skin vertices and
    /// triangles in a patch) with a bit for the front. The hits are sorted, so that the order in which they were found
    /// does not matter. `None` if a flag reports that some hits are missing.
    fn ray_hits(&self, path: usize, texel: f32, position: DVec3, orientation: DQuat) -> Option<Vec<Vec<[u32; 4]>>> {
        let params = StepParams { depth_limit: 1.0, texel, ..StepParams::zeroed() };
        self.common.params.write(&[params]).unwrap();
        self.cull.pairs.write::<Pair>(&self.model.pairs).unwrap();
        let (mut frames, mut links) = (vec![Frame::zeroed(); self.model.frames.len()], vec![Link::zeroed(); 1]);
        let placed = Frames::new(&self.model, |_| DVec3::ZERO);
        placed.write(DVec3::ZERO, self.scene.step.dt, &mut frames, &mut links);
        let tool = &mut frames[self.model.tool_frame.unwrap()];
        tool.centre = position.as_vec3().to_array();
        tool.rotation = orientation.as_quat().to_array();
        self.common.frames.write(&frames).unwrap();
        self.common.links.write(&links).unwrap();
        // Chunks hold fewer vertices than there is room for, and the rest of the room is never written.
        let room = self.skin.entry_hits.bytes() as usize / 4;
        self.skin.entry_hits.write(&vec![NONE; room]).unwrap();
        self.skin.entry_cells.write(&vec![[NONE; 2]; room]).unwrap();
        self.recordings[path].submit_and_wait().unwrap();
        assert_clean(context(), "ray_hits");

        let counts = self.common.counts.read::<Counts>().unwrap()[0];
        let first = self.skin.entry_hits.read::<u32>().unwrap();
        let squares = self.skin.entry_cells.read::<[u32; 2]>().unwrap();
        let hits = self.depths[path].hits.read::<[u32; 4]>().unwrap();
        let hash_entries = counts.work_items as usize * CHUNK_VERTICES;
        let list = |hash_entry: usize| {
            let (mut hit, mut found) = (first[hash_entry], Vec::new());
            while hit != NONE {
                let [triangle, next, depth, front] = hits[hit as usize];
                found.push([squares[hash_entry][0], triangle, depth, front]);
                hit = next;
            }
            found.sort_unstable();
            found
        };
        let all: Vec<Vec<_>> = (0..hash_entries).map(list).collect();
        let found: usize = all.iter().map(Vec::len).sum();
        assert_eq!(found, counts.hits as usize, "number of ray hits on the lists, and number counted by the kernel");
        // Other flags may be raised: at some poses a pair has more directions of contact than it may have contact
        // patches.
        (!Flags(counts.flags).contains(Flags::CONTACT_OVERFLOW)).then_some(all)
    }
}

/// Compares the paths at random poses of the tool near a vertex of the body, with grid cells whose edges, m, are the
/// `texels` in turn (0: the edge is chosen from the skins). Returns the number of hits, and the most cells along a side
/// of a contact patch.
fn compare(body: Body, tool: &Body, poses: usize, texels: &[f32]) -> (usize, f32) {
    let prepare::Shape::Rigid { skin, .. } = &body.shape else { panic!("the body is not rigid") };
    let vertices = skin.vertices.clone();
    let query = Query::new(&[body], tool);
    let mut random = Random(11);
    let (mut ray_hits, mut squares) = (0, 0.0f32);
    for pose in 0..poses {
        let vertex = vertices[random.below(vertices.len())];
        let position = vertex * (1.0 + 0.2 * random.next()) + 0.01 * random.vector();
        let orientation = random.turn(3.0);
        let texel = texels[pose % texels.len()];
        let [compute, graphics] = [0, 1].map(|path| query.ray_hits(path, texel, position, orientation).unwrap());
        assert!(compute == graphics, "pose {pose}, cells of {texel} m: ray hits differ");
        ray_hits += compute.iter().map(Vec::len).sum::<usize>();
        for contact_patch in query
            .cull
            .contact_patches
            .read::<ContactPatch>()
            .unwrap()
            .iter()
            .filter(|contact_patch| contact_patch.weight > 0.0)
        {
            let cells = contact_patch.cells_per_metre[0].max(contact_patch.cells_per_metre[1]);
            let along = |k: usize| (contact_patch.high[k] - contact_patch.low[k]) * cells;
            squares = squares.max(along(0)).max(along(1));
        }
    }
    println!("{ray_hits} ray hits, identical on both paths; up to {squares} cells along a side of a patch");
    (ray_hits, squares)
}

#[test]
fn both_paths_find_the_same_crossings_at_random_poses() {
    let scene = scene(
        "[[body]]\nname = \"pumpkin\"\nsurface = { model = \"pumpkin\", vertices = 8000 }\n\
         [tool]\nsphere = 0.04\nmass = 1.0\nposition = [0.0, 0.0, 0.0]\n",
    );
    let tool = prepare::tool(scene.tool.as_ref().unwrap(), &scene).unwrap();
    let pumpkin = prepare::body(&scene.bodies[0], &scene).unwrap();
    let (ray_hits, _) = compare(pumpkin, &tool, 24, &[0.0, 1.0, 0.02, 0.002]);
    assert!(ray_hits > 10_000, "{ray_hits} ray hits, expected more than 10000");
    // This grid has as many cells as a patch may have along a side, so that rasterization reaches the far end of the
    // grid. The triangles are small: llvmpipe, Mesa's driver for CPUs, ends loops after 65,535 rounds, and an
    // invocation of the compute path must not look through more cells than that.
    let (ray_hits, squares) = compare(tool.clone(), &tool, 6, &[1e-9]);
    let most = MOST_CELLS as f32;
    assert!(
        ray_hits > 5_000 && squares > most - 0.01 && squares <= most,
        "{ray_hits} ray hits, {squares} cells along a side of a patch"
    );
}

#[test]
#[ignore = "long: 8 s"]
fn a_loop_that_the_device_leaves_early_is_flagged() {
    // All vertices are in one cell: every triangle looks through all of them, which takes more rounds than the loops of
    // llvmpipe (Mesa's driver for CPUs) can have.
    let scene = scene(
        "[[body]]\nname = \"pumpkin\"\nsurface = { model = \"pumpkin\", vertices = 40000 }\n\
         [tool]\nsphere = 0.15\nmass = 1.0\nposition = [0.0, 0.0, 0.0]\n",
    );
    let tool = prepare::tool(scene.tool.as_ref().unwrap(), &scene).unwrap();
    let pumpkin = prepare::body(&scene.bodies[0], &scene).unwrap();
    let prepare::Shape::Rigid { skin, .. } = &pumpkin.shape else { panic!("the body is not rigid") };
    let (position, turn) = (skin.vertices[skin.vertices.len() / 2], DQuat::IDENTITY);
    let query = Query::new(&[pumpkin], &tool);
    let all = query.ray_hits(0, 0.0, position, turn).unwrap();
    let total: usize = all.iter().map(Vec::len).sum();
    assert!(total > 1000, "only {total} ray hits");
    let found = [0, 1].map(|path| query.ray_hits(path, 10.0, position, turn));
    println!(
        "{total} ray hits; with one cell for all vertices, whether each path raises a flag: {:?}",
        found.each_ref().map(Option::is_none)
    );
    assert!(found.iter().flatten().all(|found| *found == all), "a path finds other ray hits and raises no flag");
}
