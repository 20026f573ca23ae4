//! Each file operation of the built program fails once: as on a disk that is full or read-only, where a file vanishes
//! or cannot be read, or where too many files are open. Whatever fails, the program ends with one message and leaves
//! nothing behind, or does without (as without a cache) and gives the same results.
#![cfg(target_os = "linux")]

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// Most errors that an operation may give.
const KINDS: usize = 2;
/// A program that takes longer, s, hangs; each takes about one.
const HANGS: &str = "60";
/// The hidden folder of unfinished files.
const HIDDEN: &str = ".palpate-unfinished";
/// Operations that tidy up; where they fail, what they should have removed may stay.
const TIDYING: [&str; 3] = ["unlink", "rmdir", "readdir64"];

const BALL: &str = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
const SCENE: &str = "[[body]]\nname = \"block\"\nlayer = { box = [[0, 0, 0], [0.04, 0.04, 0.04]], cells = [2, 2, 2] }\n\
                     material = { young = 2e4, poisson = 0.4, density = 1000.0 }\n\
                     [tool]\nsurface = \"tool.obj\"\nmass = 0.05\nposition = [0.02, 0.045, 0.02]\n\
                     [drive]\npath = \"keys.csv\"\n";
const KEYS: &str = "t,x,y,z\n0,0.02,0.045,0.02\n0.1,0.02,0.03,0.02\n";

/// Compiles the library that makes operations fail.
fn interposer(folder: &Path) -> PathBuf {
    let (source, library) =
        (Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/file_faults/interposer.rs"), folder.join("faults.so"));
    let mut compiler = Command::new(std::env::var_os("RUSTC").unwrap_or("rustc".into()));
    compiler.args(["-O", "--edition", "2024", "--crate-type", "cdylib", "-C", "panic=abort", "-o"]);
    let made = compiler.arg(&library).arg(source).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    library
}

/// Names and contents of all files in a folder, without what is different in each run: times.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().flatten().filter(|entry| entry.path().is_file());
    files.map(|file| (file.file_name().into_string().unwrap(), untimed(&file.path()))).collect()
}

/// The content of a file without times: of a table the columns that are no times, of a text the lines, of a summary its
/// keys, of a page that it is whole.
fn untimed(file: &Path) -> Vec<u8> {
    let bytes = fs::read(file).unwrap();
    let text = || String::from_utf8(bytes.clone()).unwrap();
    match file.extension().and_then(|ending| ending.to_str()) {
        Some("csv") => {
            let text = text();
            let kept: Vec<bool> = text.lines().next().unwrap().split(',').map(|name| !name.ends_with("_us")).collect();
            let row = |line: &str| {
                let fields: Vec<&str> = line.split(',').collect();
                assert_eq!(fields.len(), kept.len(), "{}: {line}", file.display());
                fields
                    .iter()
                    .zip(&kept)
                    .filter(|(_, kept)| **kept)
                    .map(|(field, _)| *field)
                    .collect::<Vec<_>>()
                    .join(",")
            };
            text.lines().map(row).collect::<Vec<_>>().join("\n").into()
        }
        Some("txt") => {
            let is_kept = |line: &&str| !["seconds: ", "note: "].iter().any(|begin| line.starts_with(begin));
            text().lines().filter(is_kept).collect::<String>().into()
        }
        Some("json") => keys(&serde_json::from_slice(&bytes).unwrap()).into(),
        Some("html") => {
            let text = text();
            assert!(text.trim_end().ends_with("</html>"), "{} is cut short", file.display());
            b"whole".into()
        }
        _ => bytes,
    }
}

/// The keys of a JSON value, in their order; without `files`, which has a note on a cache that cannot be used.
fn keys(value: &Value) -> String {
    match value {
        Value::Object(map) => {
            let kept = map.iter().filter(|(key, _)| *key != "files");
            kept.map(|(key, value)| format!("{key} {{{}}} ", keys(value))).collect()
        }
        Value::Array(list) => list.iter().map(keys).collect(),
        _ => String::new(),
    }
}

/// Requires that a folder has the files `expected`.
fn assert_same(folder: &Path, expected: &BTreeMap<String, Vec<u8>>, what: &str) {
    let found = contents(folder);
    assert!(found.keys().eq(expected.keys()), "{what}: there are {:?}", found.keys());
    let differing: Vec<_> = expected.iter().filter(|(name, content)| found[*name] != **content).collect();
    assert!(
        differing.is_empty(),
        "{what}: other content in {:?}",
        differing.iter().map(|(name, _)| name).collect::<Vec<_>>()
    );
}

struct Trial<'a> {
    folder: tempfile::TempDir,
    library: &'a Path,
    /// File into which the library says what failed.
    says: PathBuf,
    /// A copy of the cache, from which each program starts; `None`: each starts without a cache.
    kept: Option<BTreeMap<String, Vec<u8>>>,
}

impl Trial<'_> {
    fn new(library: &Path) -> Trial<'_> {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("scene.toml", SCENE), ("tool.obj", BALL), ("keys.csv", KEYS)] {
            fs::write(folder.path().join(name), text).unwrap();
        }
        Trial { folder, library, says: library.with_file_name("says"), kept: None }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program, with the fault of this kind at this operation, if one is given.
    fn program(&self, arguments: &[&str], fault: Option<(u64, usize)>) -> Output {
        let mut program = Command::new("timeout");
        program.arg(HANGS).arg(env!("CARGO_BIN_EXE_palpate")).current_dir(self.folder.path());
        let place = |argument: &&str| match argument.strip_prefix('@') {
            Some(name) => self.path(name).into_os_string(),
            None => (*argument).into(),
        };
        program.args(arguments.iter().map(place)).env("PALPATE_CACHE", self.path("cache"));
        if let Some((at, kind)) = fault {
            let variables = [("FAULT_AT", at.to_string()), ("FAULT_KIND", kind.to_string())];
            program.envs(variables).env("FAULT_FOLDER", self.folder.path()).env("FAULT_SAYS", &self.says);
            program.env("LD_PRELOAD", self.library);
        }
        program.output().unwrap()
    }

    /// What failed last, if anything.
    fn struck(&self) -> Option<String> {
        let said = fs::read_to_string(&self.says).ok();
        let _ = fs::remove_file(&self.says);
        said.map(|said| said.trim().into())
    }

    /// Removes what the program wrote, and puts the cache back.
    fn clear(&self) {
        for name in ["out", "cache"] {
            let _ = fs::remove_dir_all(self.path(name));
        }
        for (name, bytes) in self.kept.iter().flatten() {
            fs::create_dir_all(self.path("cache")).unwrap();
            fs::write(self.path("cache").join(name), bytes).unwrap();
        }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Lets each file operation of a command fail, with a cache that is filled already or without one; returns how often
/// each did.
fn fail_each(library: &Path, command: &[&str], is_cached: bool) -> BTreeMap<String, u32> {
    let mut trial = Trial::new(library);
    let clean = trial.program(command, None);
    assert!(clean.status.success(), "{command:?}: {}", text(&clean.stderr));
    let expected = contents(&trial.path("out"));
    assert!(!expected.is_empty());
    if is_cached {
        let files = fs::read_dir(trial.path("cache")).unwrap().flatten();
        let kept = files.map(|file| (file.file_name().into_string().unwrap(), fs::read(file.path()).unwrap()));
        trial.kept = Some(kept.collect());
    }
    let mut tried = BTreeMap::new();
    for kind in 0..KINDS {
        for at in 0.. {
            trial.clear();
            let Output { status, stderr, .. } = trial.program(command, Some((at, kind)));
            let Some(struck) = trial.struck() else { break };
            let name = struck.split(' ').next().unwrap().to_string();
            let said = text(&stderr);
            let what = format!("{command:?}, operation {at}, {struck}, ended with {status} and said {said}");
            assert!(status.signal().is_none() && status.code() != Some(124) && !said.contains("panicked"), "{what}");
            if status.success() {
                // A page for which the table of the run cannot be read again is left out, with a note.
                let mut expected = expected.clone();
                if said.contains("note: no report.html was written: ") {
                    expected.remove("report.html");
                }
                assert_same(&trial.path("out"), &expected, &what);
            } else {
                assert!([Some(2), Some(4)].contains(&status.code()), "{what}");
                let errors: Vec<&str> = said.lines().filter(|line| !line.starts_with("note: ")).collect();
                assert!(errors.len() == 1 && errors[0].starts_with("error: "), "{what}");
                let left = trial.path("out");
                if left.exists() && !TIDYING.contains(&name.as_str()) {
                    let hidden = fs::read_dir(left.join(HIDDEN)).into_iter().flatten().flatten();
                    let hidden: Vec<_> = hidden.map(|entry| entry.file_name()).collect();
                    panic!("{what}, and left {:?} and hidden {hidden:?}", contents(&left).keys());
                }
                if left.exists() {
                    let again = trial.program(command, None);
                    assert!(again.status.success(), "{what}; the next run said {}", text(&again.stderr));
                    assert_same(&left, &expected, &format!("{what}; after the next run"));
                }
            }
            *tried.entry(name).or_default() += 1;
        }
    }
    println!("{command:?}: {} faults tried: {tried:?}", tried.values().sum::<u32>());
    tried
}

#[test]
#[ignore = "long: minutes"]
fn lasting_every_file_operation_may_fail() {
    // Without a cache a run measures which kernels are faster, and may choose others each time.
    let run = ["run", "@scene.toml", "--arrays", "storage", "--depth", "compute", "--steps", "3", "--out", "@out"];
    let commands: &[(&[&str], bool)] = &[
        (&["prepare", "@tool.obj", "--cells", "20", "--out", "@out"], false),
        (&["query", "@tool.obj", "@tool.obj", "--runs", "1", "--out", "@out"], false),
        (&["run", "@scene.toml", "--explain", "--out", "@out"], true),
        (&run, false),
        (&run, true),
        #[cfg(feature = "view")]
        (&["film", "@scene.toml", "--seconds", "0.1", "--size", "64x48", "--out", "@out"], true),
    ];
    let folder = tempfile::tempdir().unwrap();
    let library = interposer(folder.path());
    let mut tried = BTreeMap::<String, u32>::new();
    for (command, is_cached) in commands {
        for (name, count) in fail_each(&library, command, *is_cached) {
            *tried.entry(name).or_default() += count;
        }
    }
    println!("{} faults in all: {tried:?}", tried.values().sum::<u32>());
    for name in ["flock", "mkdir", "open64", "opendir", "read", "rename", "statx", "unlink", "write"] {
        assert!(tried.contains_key(name), "{name} never failed: {tried:?}");
    }
}
