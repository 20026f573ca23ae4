//! The shipped scenes on this machine's Vulkan device give what is pinned for `palpate selftest`. With the environment
//! variable `PALPATE_WRITE_PINNED` set, the test pins what they give.

use std::path::Path;

use palpate::{Context, Options};
use palpate_bench::selftest;

#[test]
#[ignore = "long: half a minute"]
fn shipped_scenes_give_what_is_pinned() {
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    let options = Options { device, ..Options::of_program() };
    if std::env::var_os("PALPATE_WRITE_PINNED").is_some() {
        let found = selftest::record(&Context::open(&options).unwrap()).unwrap();
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/selftest/pinned.json");
        std::fs::write(file, serde_json::to_string_pretty(&found).unwrap() + "\n").unwrap();
        return;
    }
    let results = selftest::run(&options, &mut |_| ()).unwrap();
    assert_eq!(results.faults(), Vec::<String>::new());
}
