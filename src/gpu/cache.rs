//! Keeps Vulkan's pipeline cache (compiled shaders) between runs, in one file per device and driver. The cache only
//! saves compile time: a missing, corrupt or unwritable file is ignored without a message.

use std::path::{Path, PathBuf};
use std::{env, fs, process};

/// First bytes of a cache file. There follow the length of the blob (the driver's cache data), a checksum of the blob,
/// and the blob itself. The checksum is needed because drivers check little of a blob.
const MAGIC: &[u8; 8] = b"palpate1";

/// The driver's blob that an earlier run stored in `folder` for the device and driver `key`; empty if there is none, or
/// if the file is corrupt.
pub(super) fn load(folder: &Path, key: &str) -> Vec<u8> {
    fs::read(file(folder, key)).ok().and_then(|bytes| unpack(&bytes)).unwrap_or_default()
}

/// Stores the driver's blob in `folder` for later runs, under the device and driver `key`.
pub(super) fn save(folder: &Path, key: &str, blob: &[u8]) {
    let path = file(folder, key);
    if fs::create_dir_all(folder).is_err() || load(folder, key) == blob {
        return;
    }
    // A temporary file is written and then renamed, so that a reader never sees half a file.
    let partial = path.with_extension(format!("{}.partial", process::id()));
    if fs::write(&partial, pack(blob)).is_err() || fs::rename(&partial, &path).is_err() {
        let _ = fs::remove_file(&partial);
    }
}

fn file(folder: &Path, key: &str) -> PathBuf {
    folder.join(format!("pipelines-{key}.bin"))
}

/// The user's cache folder: `PALPATE_CACHE`, else `palpate` in `XDG_CACHE_HOME` (or the operating system's equivalent),
/// else in `~/.cache`.
pub(super) fn user_folder() -> Option<PathBuf> {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let home = || set("HOME").map(|h| h.join(if cfg!(target_os = "macos") { "Library/Caches" } else { ".cache" }));
    let general = || set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")).or_else(home);
    set("PALPATE_CACHE").or_else(|| general().map(|folder| folder.join("palpate")))
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

/// The 64-bit FNV-1a hash.
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
            assert_eq!(unpack(&spoiled), None, "a file whose byte {at} is wrong must be ignored");
            assert_eq!(unpack(&packed[..at]), None, "a file cut off at byte {at} must be ignored");
        }
    }
}
