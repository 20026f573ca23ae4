//! A cache of prepared bodies and of other results that take long to compute. Each result is an *entry*: one file,
//! named after a key, the digest of everything that the result depends on.
//!
//! The cache only saves time. An entry holds its own key and a checksum, so that an entry which is damaged, truncated,
//! written by another version of the code or stored under another entry's name is recognised and made again. An entry
//! is written to a temporary file, which is then renamed, so that other processes never see a partly written entry.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::sources::SOURCES;
use crate::gpu::{Context, Options};

/// The first bytes of an entry's file.
const MAGIC: &[u8; 8] = b"palpbody";
/// Number of bytes of a SHA-256 digest.
const DIGEST: usize = 32;
/// Number of bytes before the payload: magic number, key, length of the payload, checksum of the payload.
const HEADER: usize = MAGIC.len() + DIGEST + 8 + DIGEST;
/// Extension of an entry's file name.
const ENDING: &str = "body";
/// When all entries together exceed this number of bytes, the oldest ones are removed.
const MOST_BYTES: u64 = 2 << 30;

/// Digest of everything that a cached value depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Key([u8; DIGEST]);

/// Computes the key of a value from the fields that it depends on. Each field is preceded by its length, so that no two
/// lists of fields give the same bytes.
pub struct KeyMaker(Sha256);

impl KeyMaker {
    /// Starts with the source texts of all preparation code as the first fields: they serve as the code's version.
    pub fn new() -> Self {
        Self::of(SOURCES)
    }

    /// Starts with the given source texts as the first fields.
    pub fn of(sources: &[&str]) -> Self {
        let mut maker = KeyMaker(Sha256::new());
        sources.iter().for_each(|source| maker.add(source.as_bytes()));
        maker
    }

    /// Adds a field to the key.
    pub fn add(&mut self, field: &[u8]) {
        self.0.update((field.len() as u64).to_le_bytes());
        self.0.update(field);
    }

    /// The key of all fields that were added.
    pub fn finish(self) -> Key {
        Key(self.0.finalize().into())
    }
}

impl Default for KeyMaker {
    fn default() -> Self {
        Self::new()
    }
}

/// Result of looking up a key.
#[derive(Debug, PartialEq)]
pub enum Entry<T> {
    /// A valid entry was found.
    Found(T),
    /// There is no entry, or the cache is switched off.
    Missing,
    /// The entry in this file is invalid.
    Damaged(PathBuf),
}

/// A folder of entries, or a cache that is switched off.
#[derive(Debug, Clone)]
pub struct Cache {
    folder: Option<PathBuf>,
}

impl Cache {
    /// The user's cache, in the folder [`Options::user_cache`].
    pub fn of_user() -> Self {
        Cache { folder: Options::user_cache() }
    }

    /// The cache of a GPU context, in the folder [`Options::cache`].
    pub fn of(context: &Context) -> Self {
        Cache { folder: context.cache_folder().map(Path::to_path_buf) }
    }

    /// A cache in this folder, which is created with the first entry.
    pub fn at(folder: &Path) -> Self {
        Cache { folder: Some(folder.into()) }
    }

    /// A cache that is switched off: nothing is ever found or stored.
    pub fn off() -> Self {
        Cache { folder: None }
    }

    /// Whether there is a folder to look in.
    pub fn is_on(&self) -> bool {
        self.folder.is_some()
    }

    /// The file in which the value of a key is or would be stored; `None` if the cache is switched off.
    pub fn path(&self, key: &Key) -> Option<PathBuf> {
        let name: String = key.0.iter().map(|byte| format!("{byte:02x}")).collect();
        self.folder.as_ref().map(|folder| folder.join(name).with_extension(ENDING))
    }

    /// Looks up the value of a key.
    pub fn load<T: DeserializeOwned>(&self, key: &Key) -> Entry<T> {
        let Some(path) = self.path(key) else { return Entry::Missing };
        match fs::read(&path) {
            Ok(bytes) => {
                let value = unpack(key, &bytes).and_then(|payload| postcard::from_bytes(payload).ok());
                value.map_or(Entry::Damaged(path), Entry::Found)
            }
            // Where the folder cannot be, `store` says so.
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Entry::Missing,
            Err(_) => Entry::Damaged(path),
        }
    }

    /// Stores the value of a key. If this fails, the error gives the reason; the caller may ignore the error.
    pub fn store<T: Serialize>(&self, key: &Key, value: &T) -> Result<(), String> {
        let (Some(path), Some(folder)) = (self.path(key), &self.folder) else { return Ok(()) };
        let failed = |error: std::io::Error| format!("the cache in {} cannot be written: {error}", folder.display());
        let payload = postcard::to_stdvec(value)
            .map_err(|error| format!("the value cannot be serialised for caching: {error}"))?;
        fs::create_dir_all(folder).map_err(failed)?;
        // Process id and call number make the temporary name unique: two threads may store the same entry at once.
        static CALLS: AtomicU64 = AtomicU64::new(0);
        let call = CALLS.fetch_add(1, Ordering::Relaxed);
        let partial = path.with_extension(format!("{}-{call}.partial", std::process::id()));
        let written = fs::write(&partial, pack(key, &payload)).and_then(|()| fs::rename(&partial, &path));
        if written.is_err() {
            // If the temporary file cannot be removed either, it stays; this need not be reported.
            let _ = fs::remove_file(&partial);
        }
        written.map_err(failed)?;
        trim(folder, &path, MOST_BYTES);
        Ok(())
    }
}

fn pack(key: &Key, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u64).to_le_bytes();
    [MAGIC.as_slice(), &key.0, &length, Sha256::digest(payload).as_slice(), payload].concat()
}

/// The payload of an entry, if the entry is valid and belongs to this key.
fn unpack<'a>(key: &Key, bytes: &'a [u8]) -> Option<&'a [u8]> {
    let (header, payload) = bytes.split_at_checked(HEADER)?;
    let expected = pack(key, payload);
    (header == &expected[..HEADER]).then_some(payload)
}

/// Removes the oldest entries until the folder holds at most `most` bytes, but never the entry just written, whose file
/// is `newest`. Failures are ignored: a cache that is too large does no harm to this run.
fn trim(folder: &Path, newest: &Path, most: u64) {
    let Ok(listing) = fs::read_dir(folder) else { return };
    let mut entries: Vec<(SystemTime, PathBuf, u64)> = Vec::new();
    for entry in listing.flatten() {
        if entry.path().extension().is_some_and(|ending| ending == ENDING)
            && let Ok(facts) = entry.metadata()
        {
            entries.push((facts.modified().unwrap_or(SystemTime::UNIX_EPOCH), entry.path(), facts.len()));
        }
    }
    entries.sort();
    let mut total: u64 = entries.iter().map(|entry| entry.2).sum();
    for (_, path, bytes) in entries.iter().filter(|entry| entry.1 != newest) {
        if total <= most {
            return;
        }
        if fs::remove_file(path).is_ok() {
            total -= bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Value = (Vec<f64>, String);

    fn value(seed: f64) -> Value {
        ((0..100).map(|i| seed + f64::from(i)).collect(), "a body".into())
    }

    fn key(text: &str) -> Key {
        let mut maker = KeyMaker::new();
        maker.add(text.as_bytes());
        maker.finish()
    }

    fn stored(folder: &Path, names: &[&str]) -> Cache {
        let cache = Cache::at(folder);
        for (i, name) in names.iter().enumerate() {
            cache.store(&key(name), &value(i as f64)).unwrap();
        }
        cache
    }

    #[test]
    fn what_is_kept_is_found_bit_for_bit_and_under_its_key_only() {
        let folder = tempfile::tempdir().unwrap();
        let cache = stored(&folder.path().join("made/for/it"), &["a", "b"]);
        assert_eq!(cache.load(&key("a")), Entry::Found(value(0.0)));
        assert_eq!(cache.load(&key("b")), Entry::Found(value(1.0)));
        assert_eq!(cache.load::<Value>(&key("c")), Entry::Missing);
        assert_eq!(Cache::off().load::<Value>(&key("a")), Entry::Missing);
        assert!(Cache::off().store(&key("a"), &value(0.0)).is_ok());
        // A folder that cannot be has no entry, damaged or not.
        fs::write(folder.path().join("file"), "").unwrap();
        let nowhere = Cache::at(&folder.path().join("file/below"));
        assert_eq!(nowhere.load::<Value>(&key("a")), Entry::Missing);
        assert!(nowhere.store(&key("a"), &value(0.0)).unwrap_err().contains("cannot be written"));
    }

    #[test]
    fn fields_are_framed() {
        let of = |fields: &[&str]| {
            let mut maker = KeyMaker::new();
            fields.iter().for_each(|field| maker.add(field.as_bytes()));
            maker.finish()
        };
        assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
        assert_ne!(of(&["ab"]), of(&["ab", ""]));
        assert_eq!(of(&["ab"]), of(&["ab"]));
    }

    #[test]
    fn an_entry_with_any_byte_flipped_is_not_trusted() {
        let folder = tempfile::tempdir().unwrap();
        let cache = stored(folder.path(), &["a"]);
        let path = cache.path(&key("a")).unwrap();
        let sound = fs::read(&path).unwrap();
        for at in 0..sound.len() {
            let mut bytes = sound.clone();
            bytes[at] ^= 1 << (at % 8);
            fs::write(&path, &bytes).unwrap();
            assert_eq!(
                cache.load::<Value>(&key("a")),
                Entry::Damaged(path.clone()),
                "an entry with byte {at} changed was accepted"
            );
        }
        fs::write(&path, &sound).unwrap();
        assert_eq!(cache.load(&key("a")), Entry::Found(value(0.0)));
    }

    #[test]
    fn an_entry_cut_short_or_drawn_out_is_not_trusted() {
        let folder = tempfile::tempdir().unwrap();
        let cache = stored(folder.path(), &["a"]);
        let path = cache.path(&key("a")).unwrap();
        let sound = fs::read(&path).unwrap();
        for length in [0, 1, HEADER - 1, HEADER, HEADER + 1, sound.len() - 1] {
            fs::write(&path, &sound[..length]).unwrap();
            assert_eq!(
                cache.load::<Value>(&key("a")),
                Entry::Damaged(path.clone()),
                "an entry cut to {length} bytes was accepted"
            );
        }
        fs::write(&path, [sound.as_slice(), b"x"].concat()).unwrap();
        assert_eq!(cache.load::<Value>(&key("a")), Entry::Damaged(path));
    }

    #[test]
    fn entries_under_each_others_names_are_not_trusted() {
        let folder = tempfile::tempdir().unwrap();
        let cache = stored(folder.path(), &["a", "b"]);
        let (a, b) = (cache.path(&key("a")).unwrap(), cache.path(&key("b")).unwrap());
        let kept = fs::read(&a).unwrap();
        fs::rename(&b, &a).unwrap();
        fs::write(&b, kept).unwrap();
        assert_eq!(cache.load::<Value>(&key("a")), Entry::Damaged(a));
        assert_eq!(cache.load::<Value>(&key("b")), Entry::Damaged(b));
    }

    #[test]
    fn a_sound_entry_of_another_type_is_not_trusted() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        cache.store(&key("a"), &7u8).unwrap();
        assert!(matches!(cache.load::<Value>(&key("a")), Entry::Damaged(_)));
    }

    #[test]
    fn a_folder_that_cannot_be_is_a_note() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let cache = Cache::at(&folder.path().join("file/under"));
        let note = cache.store(&key("a"), &value(0.0)).unwrap_err();
        assert!(note.contains("file/under") && note.contains("cannot be written"), "unexpected error text: {note}");
        assert_ne!(cache.load(&key("a")), Entry::Found(value(0.0)));
    }

    #[test]
    fn many_writers_and_readers_of_one_key_see_whole_entries_only() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        let big: Value = (vec![0.5; 100_000], "large".into());
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..10).for_each(|_| cache.store(&key("a"), &big).unwrap()));
                scope.spawn(|| {
                    for _ in 0..50 {
                        assert!(!matches!(cache.load::<Value>(&key("a")), Entry::Damaged(_)));
                    }
                });
            }
        });
        assert_eq!(cache.load(&key("a")), Entry::Found(big));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn the_oldest_entries_go_first_and_the_newest_never() {
        let folder = tempfile::tempdir().unwrap();
        let cache = stored(folder.path(), &["a", "b", "c"]);
        let path = |name: &str| cache.path(&key(name)).unwrap();
        for (age, name) in ["c", "a", "b"].iter().enumerate() {
            let time = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1000 + age as u64);
            fs::File::options().write(true).open(path(name)).unwrap().set_modified(time).unwrap();
        }
        let one = fs::metadata(path("a")).unwrap().len();
        trim(folder.path(), &path("c"), 2 * one);
        assert_eq!([path("a"), path("b"), path("c")].map(|p| p.exists()), [false, true, true]);
        trim(folder.path(), &path("c"), 0);
        assert!(path("c").exists() && !path("b").exists());
    }
}
