//! Preparation: a body is made of whatever OBJ file is accepted, if it is small.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate::internal::prepare::{self, Cache, Shape};
use palpate::scene::triangles;
use palpate_fuzz::{fair, in_file, scene};

const SCENE: &str = "[[body]]\nname = \"b\"\nsurface = \"mesh.obj\"\nlayer = { across = 4 }\n\
                     material = { young = 1e4, poisson = 0.4, density = 1e3 }\n";
/// Number of triangles above which a mesh is left alone, since preparation takes long.
const MOST: usize = 200;

fuzz_target!(|bytes: &[u8]| {
    in_file("mesh.obj", bytes, |path| {
        let Ok(mesh) = triangles::read(path).map(|file| file.mesh) else { return };
        if mesh.triangles.len() > MOST {
            return;
        }
        let scene = scene(path.parent().expect("a folder"), SCENE).expect("a scene");
        let made = prepare::body_and_report(&scene.bodies[0], &scene, &Cache::off(), &mut |_| Ok(()));
        let Some((body, _)) = fair(made) else { return };
        let Shape::Soft { layer, .. } = &body.shape else { panic!("a soft body was asked for") };
        assert!(layer.nodes.iter().all(|node| node.is_finite()));
    });
});
