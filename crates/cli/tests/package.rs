//! Tests of the installed package of palpate, an engine for haptic touch of soft bodies, whose library has a C
//! interface: CMake and pkg-config find the files that `install.sh` puts into a folder; C programs link with the
//! library in that folder and run, even after the folder was moved; the library exports only the functions of its C
//! interface.

#[path = "../../capi/tests/ffi_help/mod.rs"]
mod ffi_help;

use std::path::{Path, PathBuf};
use std::process::Command;

use ffi_help::{BLOCK, SPHERE, library, root};

fn output(command: &mut Command) -> String {
    let done = command
        .output()
        .unwrap_or_else(|error| panic!("{command:?}: {error}; ./setup.sh --tests installs the program"));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(done.status.success(), "{command:?} failed: output {}, errors {}", text(&done.stdout), text(&done.stderr));
    text(&done.stdout)
}

/// Installs the program and the libraries that were built together with this test, then moves the folder that holds
/// them; returns that folder (the new prefix) and the path of a scene file.
fn installed(folder: &Path) -> (PathBuf, PathBuf) {
    let (built, first, second) = (folder.join("built"), folder.join("first"), folder.join("second place"));
    std::fs::create_dir(&built).unwrap();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_palpate"));
    for file in [program, library().join("libpalpate_capi.so"), library().join("libpalpate_capi.a")] {
        std::fs::copy(&file, built.join(file.file_name().unwrap())).unwrap();
    }
    let script = root().join("install.sh");
    output(Command::new(&script).arg("--prefix").arg(&first).arg("--built").arg(&built));
    std::fs::remove_dir_all(&built).unwrap();
    std::fs::rename(&first, &second).unwrap();
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, format!("{BLOCK}{SPHERE}")).unwrap();
    (second, scene)
}

/// Runs the compiled C example `examples/c/touch.c` for three steps of the scene; it must print one line per step.
fn runs(program: &Path, scene: &Path) {
    let said = output(Command::new(program).arg(scene).arg("3"));
    assert_eq!(said.lines().count(), 3, "the example must print three lines; it printed: {said}");
}

#[test]
fn cmake_and_pkg_config_find_what_was_installed() {
    let folder = tempfile::tempdir().unwrap();
    let (prefix, scene) = installed(folder.path());
    let source = root().join("examples/c/touch.c");
    let project = "cmake_minimum_required(VERSION 3.16)\nproject(touch C)\nfind_package(palpate 0.1 REQUIRED)\n\
                   add_executable(shared ${SOURCE})\ntarget_link_libraries(shared palpate::palpate)\n\
                   add_executable(static ${SOURCE})\ntarget_link_libraries(static palpate::static)\n";
    std::fs::write(folder.path().join("CMakeLists.txt"), project).unwrap();
    let built = folder.path().join("cmake");
    let define = |name: &str, value: &Path| format!("-D{name}={}", value.display());
    output(
        Command::new("cmake")
            .arg("-S")
            .arg(folder.path())
            .arg("-B")
            .arg(&built)
            .args([define("CMAKE_PREFIX_PATH", &prefix), define("SOURCE", &source)]),
    );
    output(Command::new("cmake").arg("--build").arg(&built));
    runs(&built.join("shared"), &scene);
    runs(&built.join("static"), &scene);

    let ask = |arguments: &[&str]| {
        let mut pkg_config = Command::new("pkg-config");
        let said =
            output(pkg_config.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig")).args(arguments).arg("palpate"));
        said.trim().to_owned()
    };
    assert_eq!(ask(&["--modversion"]), env!("CARGO_PKG_VERSION"));
    let (flags, libraries) = (ask(&["--cflags", "--libs"]), ask(&["--static", "--libs"]));
    let program = folder.path().join("touch");
    // The prefix has a blank in it, which pkg-config escapes in the flags, so a shell must split them into words.
    let line =
        format!("gcc '{}' {flags} '-Wl,-rpath,{}/lib' -o '{}'", source.display(), prefix.display(), program.display());
    output(Command::new("sh").args(["-c", &line]));
    runs(&program, &scene);
    assert!(
        libraries.contains("-lpalpate") && libraries.contains("-lpthread"),
        "`pkg-config --static --libs` printed: {libraries}"
    );
}

#[test]
fn the_script_says_what_is_wrong_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path().join("prefix");
    for (arguments, words) in [
        (vec!["--prefix"], "--prefix needs a folder"),
        (vec!["--fast"], "--fast is not known"),
        (vec!["--prefix", prefix.to_str().unwrap(), "--built", "/nowhere"], "/nowhere has no"),
    ] {
        let done = Command::new(root().join("install.sh")).args(&arguments).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        assert!(
            done.status.code() == Some(2) && said.contains(words) && said.lines().count() == 1,
            "install.sh {arguments:?}: wrong error: {said}"
        );
        assert!(!prefix.exists());
    }
}

#[test]
fn the_shared_library_gives_away_its_interface_alone_and_needs_no_vulkan_to_be_loaded() {
    let shared = library().join("libpalpate_capi.so");
    let symbols = output(Command::new("nm").args(["-D", "--defined-only"]).arg(&shared));
    let names: Vec<&str> = symbols.lines().filter_map(|line| line.split(' ').next_back()).collect();
    assert!(
        names.len() > 20 && names.iter().all(|name| name.starts_with("palpate_")),
        "more than 20 names must be exported, and all must begin with palpate_: {names:?}"
    );
    let header = std::fs::read_to_string(root().join("crates/capi/src/palpate.h")).unwrap();
    for name in names {
        assert!(header.contains(&format!("{name}(")), "the exported function {name} is not declared in palpate.h");
    }
    let needed = output(Command::new("readelf").arg("-d").arg(&shared));
    let needed: Vec<&str> = needed.lines().filter(|line| line.contains("(NEEDED)")).collect();
    let system = ["libc.so", "libm.so", "libgcc_s.so", "ld-linux"];
    assert!(
        !needed.is_empty() && needed.iter().all(|line| system.iter().any(|name| line.contains(name))),
        "the library may need only system libraries, but it needs: {needed:?}"
    );
}
