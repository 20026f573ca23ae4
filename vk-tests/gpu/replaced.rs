//! Tests that the option `Options::replaced` puts another kernel (compute shader) with the same interface in a kernel's
//! place. Mutation tests use this option: they plant a fault in a shader and expect a check to fail.

use palpate::internal::gpu::{Buffer, Kernel, Memory, Recorder, Size};
use palpate::{Context, Options};

use palpate::internal::shaders::test::Bump;

use crate::harness::assert_clean;
use crate::harness::spoil::spoiled;

fn open(replaced: Vec<(String, Vec<u8>)>) -> palpate::Result<std::sync::Arc<Context>> {
    crate::harness::turn();
    let device = std::env::var("PALPATE_TEST_DEVICE").ok();
    Context::open(&Options { device, validation: crate::harness::validation(), replaced, ..Options::of_program() })
}

#[test]
fn a_replaced_kernel_runs_in_its_place_and_an_unknown_name_is_refused() {
    let bytes = spoiled("test/bump", "cells[i] * 3 + amount", "cells[i] * 3 - amount");
    for (replaced, expected) in [(vec![], 13), (vec![("test/bump".to_string(), bytes.clone())], u32::MAX - 6)] {
        let context = open(replaced).unwrap();
        let kernel = Kernel::new(&context, "test/bump", Size::Group, &[]).unwrap();
        let cells = Buffer::from_slice(&context, "cells", &[1u32; 5], Memory::Device).unwrap();
        let mut recorder = Recorder::new(&context).unwrap();
        recorder.stage("bump");
        recorder.dispatch(&kernel, &Bump { amount: 10, count: 5, cells: &cells }, 5);
        recorder.finish().unwrap().submit_and_wait().unwrap();
        assert_eq!(cells.read::<u32>().unwrap(), [expected; 5]);
        assert_clean(&context, "a replaced kernel");
    }
    let Err(error) = open(vec![("test/dump".into(), bytes)]) else { panic!("an unknown kernel was replaced") };
    assert!(error.to_string().contains("test/dump; the nearest is test/bump"), "wrong error: {error}");
    let odd = open(vec![("test/bump".into(), vec![3, 2, 35])]).unwrap();
    let Err(error) = Kernel::new(&odd, "test/bump", Size::Group, &[]) else { panic!("three bytes made a kernel") };
    assert!(error.to_string().contains("3 bytes"), "wrong error: {error}");
}
