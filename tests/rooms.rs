//! Checks imports between the engine's top-level modules ("rooms"). The list `ROOMS` orders them from lowest to
//! highest. A module may import only modules below itself, so that it can be read, and some day used, without the
//! modules above it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The modules from the lowest to the highest.
const ROOMS: [&str; 12] =
    ["error", "memory", "files", "gpu", "shaders", "scene", "prepare", "stages", "plan", "query", "step", "haptics"];

/// The files of a module: `src/NAME.rs` and all that lies in `src/NAME`.
fn files(room: &str) -> Vec<PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut found, mut folders) = (vec![source.join(format!("{room}.rs"))], vec![source.join(room)]);
    found.retain(|file| file.exists());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    found
}

/// True if a file is compiled for tests only: such a file may import modules above its own, to make its test data.
fn is_for_tests(file: &Path) -> bool {
    file.components().any(|part| part.as_os_str().to_string_lossy().trim_end_matches(".rs").ends_with("tests"))
}

/// The modules that a source text names by `crate::NAME` or in `use crate::{..}`; comments and the module `tests` at
/// the end of the text are left out.
fn imports(text: &str) -> BTreeSet<String> {
    let text = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    let code: Vec<&str> = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let code = code.join(" ");
    let mut names = BTreeSet::new();
    for after in code.split("crate::").skip(1) {
        match after.strip_prefix('{') {
            None => names.insert(first_word(after)),
            Some(list) => {
                let mut depth = 0;
                let mut item = String::new();
                for letter in list.chars() {
                    match letter {
                        '{' => depth += 1,
                        '}' if depth == 0 => break,
                        '}' => depth -= 1,
                        ',' if depth == 0 => {
                            names.insert(first_word(&std::mem::take(&mut item)));
                            continue;
                        }
                        _ => {}
                    }
                    item.push(letter);
                }
                names.insert(first_word(&item))
            }
        };
    }
    names.retain(|name| ROOMS.contains(&name.as_str()));
    names
}

fn first_word(text: &str) -> String {
    text.trim_start().chars().take_while(|letter| letter.is_alphanumeric() || *letter == '_').collect()
}

/// The modules that a file of the module `room` with this text imports although they are not below `room`.
fn upward(room: &str, text: &str) -> Vec<String> {
    let level = |name: &str| ROOMS.iter().position(|known| *known == name);
    imports(text).into_iter().filter(|name| name != room && level(name) >= level(room)).collect()
}

#[test]
fn every_room_imports_only_rooms_below_it() {
    let library = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    let declared: Vec<&str> = library.lines().filter_map(|line| line.split_once("mod ")?.1.strip_suffix(';')).collect();
    assert!(
        declared.len() == ROOMS.len() && declared.iter().all(|room| ROOMS.contains(room)),
        "ROOMS must list the modules that src/lib.rs declares: {declared:?}"
    );
    let mut wrong = Vec::new();
    for room in ROOMS {
        let files = files(room);
        assert!(!files.is_empty(), "module {room} has no files");
        for file in files.iter().filter(|file| !is_for_tests(file)) {
            let text = fs::read_to_string(file).unwrap();
            wrong.extend(upward(room, &text).into_iter().map(|name| format!("{}: {name}", file.display())));
        }
    }
    assert!(wrong.is_empty(), "files that import a module that is not below their own: {wrong:#?}");
}

#[test]
fn an_upward_import_is_seen_however_it_is_written() {
    for planted in [
        "use crate::step::Simulation;",
        "use crate::{Error, Result, step::{self, Tool}};",
        "use crate::{\n    Result,\n    query::Query,\n};",
        "fn f() { crate::haptics::clock::now(); }",
        "#[cfg(test)]\nmod tests;\nuse crate::step::Simulation;",
    ] {
        assert_eq!(upward("stages", planted).len(), 1, "number of upward imports found in: {planted}");
    }
    for fine in [
        "use crate::gpu::Buffer;",
        "// crate::step",
        "use super::model;",
        "\n#[cfg(test)]\nmod tests {\n    use crate::step::X;\n}",
    ] {
        assert!(upward("stages", fine).is_empty(), "an upward import was reported in: {fine}");
    }
}
