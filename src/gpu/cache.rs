//! The pipeline cache kept between runs, one file per device and driver in the user's cache folder. Only a help: a
//! missing, corrupt or unwritable one is passed over in silence.

use std::path::PathBuf;
use std::{env, fs, process};

/// Opens our file; the driver's own blob follows a length and a checksum, since drivers check little of it.
const MAGIC: &[u8; 8] = b"palpate1";

/// The driver's blob of the last run, empty when there is none to trust.
pub(super) fn load(key: &str) -> Vec<u8> {
    file(key).and_then(|path| fs::read(path).ok()).and_then(|bytes| unpack(&bytes)).unwrap_or_default()
}

/// Keeps the driver's blob for the next run.
pub(super) fn save(key: &str, blob: &[u8]) {
    let Some(path) = file(key) else { return };
    let Some(folder) = path.parent() else { return };
    if fs::create_dir_all(folder).is_err() || load(key) == blob {
        return;
    }
    // Written beside and renamed, so that a reader never sees half a file.
    let partial = path.with_extension(format!("{}.partial", process::id()));
    if fs::write(&partial, pack(blob)).is_err() || fs::rename(&partial, &path).is_err() {
        let _ = fs::remove_file(&partial);
    }
}

fn file(key: &str) -> Option<PathBuf> {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")).or_else(|| {
        set("HOME").map(|home| home.join(if cfg!(target_os = "macos") { "Library/Caches" } else { ".cache" }))
    })?;
    Some(folder.join("palpate").join(format!("pipelines-{key}.bin")))
}

fn pack(blob: &[u8]) -> Vec<u8> {
    [MAGIC.as_slice(), &(blob.len() as u64).to_le_bytes(), &checksum(blob).to_le_bytes(), blob].concat()
}

fn unpack(bytes: &[u8]) -> Option<Vec<u8>> {
    let (header, blob) = (bytes.get(..24)?, bytes.get(24..)?);
    let number = |range: std::ops::Range<usize>| header.get(range)?.try_into().ok().map(u64::from_le_bytes);
    let sound = &header[..8] == MAGIC && number(8..16)? == blob.len() as u64 && number(16..24)? == checksum(blob);
    sound.then(|| blob.to_vec())
}

/// FNV-1a, 64 bits.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &b| (hash ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corrupt_cache_is_passed_over() {
        let packed = pack(b"pipelines");
        assert_eq!(unpack(&packed), Some(b"pipelines".to_vec()));
        for at in 0..packed.len() {
            let mut spoiled = packed.clone();
            spoiled[at] ^= 1;
            assert_eq!(unpack(&spoiled), None, "byte {at} spoiled");
            assert_eq!(unpack(&packed[..at]), None, "cut at {at}");
        }
    }
}
