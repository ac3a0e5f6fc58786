//! Things that take long to make, kept from one run to the next.
//!
//! One folder for all of them, `fluorspar` in the user's folder of caches. What is kept there is named by what it was made of,
//! and by the program that made it: another program or other parameters find nothing. The folder may be deleted at any
//! time. It is bounded: what was not used for the longest time goes first.

use std::env;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::store::input::read_bounded;
use crate::store::output::write_atomically;
use fluorspar::digest::sha256_hex;

/// Bytes that the user's cache takes at most.
const USER_BYTES: u64 = 1 << 30;
const MAGIC: &[u8; 8] = b"FLSPCACH";
/// Layout of the files.
const FORMAT: u32 = 1;
/// Magic, format, checksum, length.
const HEAD: usize = 8 + 4 + 8 + 8;
const ENDING: &str = "cache";

/// A folder of things that can be made again.
///
/// It never fails: where nothing can be read or kept, things are made. Any number of processes may use it at once.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    most_bytes: u64,
    /// The program that makes the things, of whose change nothing else tells.
    program: String,
}

impl Cache {
    /// The user's: in `XDG_CACHE_HOME`, else in `.cache` of `HOME` (`LOCALAPPDATA` on Windows), else in the folder for
    /// temporary files; at most 1 GiB. `None` where there is no place that belongs to the user alone.
    pub fn of_user() -> Option<Self> {
        Some(Self::new(user_folder()?, USER_BYTES, &running_program()?))
    }

    /// One of at most so many bytes in a folder, which is made when something is kept. `program` names the program that makes
    /// what is kept, with its version.
    pub fn new(folder: PathBuf, most_bytes: u64, program: &str) -> Self {
        Self { folder, most_bytes, program: program.into() }
    }

    /// What was made of a key before, else what `make` makes of it now, which is kept then. `kind` is a short word for people
    /// who look into the folder; `key` is all that the result depends on.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn get_or_make<E>(
        &self,
        kind: &str,
        key: &[u8],
        make: impl FnOnce() -> Result<Vec<u8>, E>,
    ) -> Result<Vec<u8>, E> {
        if let Some(bytes) = self.get(kind, key) {
            return Ok(bytes);
        }
        let bytes = make()?;
        self.put(kind, key, &bytes);
        Ok(bytes)
    }

    /// Whether something was kept, whole or not.
    pub fn has(&self, kind: &str, key: &[u8]) -> bool {
        self.path(kind, key).is_file()
    }

    /// What was kept, if it is there and whole.
    pub fn get(&self, kind: &str, key: &[u8]) -> Option<Vec<u8>> {
        let path = self.path(kind, key);
        let mut file = read_bounded(&path, self.most_bytes).ok()?;
        let head = file.get(..HEAD)?;
        let word = |at: usize| head[at..at + 8].try_into().map(u64::from_le_bytes).unwrap_or(0);
        let whole = head.starts_with(MAGIC)
            && head[8..12] == FORMAT.to_le_bytes()
            && word(20) == (file.len() - HEAD) as u64
            && word(12) == checksum(&file[HEAD..]);
        if !whole {
            // Damaged by the disk or by another hand.
            let _ = fs::remove_file(&path);
            return None;
        }
        // The time of the last use decides what goes first.
        let _ =
            File::options().append(true).open(&path).and_then(|file| file.set_modified(SystemTime::now()));
        file.drain(..HEAD);
        Some(file)
    }

    /// Keeps a result, if it is not larger than half of the cache and there is room.
    pub fn put(&self, kind: &str, key: &[u8], bytes: &[u8]) {
        if bytes.len() as u64 > self.most_bytes / 2 || make_own_folder(&self.folder).is_none() {
            return;
        }
        // What can't be kept is made again.
        let _ = write_atomically(&self.path(kind, key), |file| {
            file.write_all(MAGIC)?;
            file.write_all(&FORMAT.to_le_bytes())?;
            file.write_all(&checksum(bytes).to_le_bytes())?;
            file.write_all(&(bytes.len() as u64).to_le_bytes())?;
            file.write_all(bytes)
        });
        self.remove_oldest();
    }

    fn path(&self, kind: &str, key: &[u8]) -> PathBuf {
        let name = sha256_hex([self.program.as_bytes(), b"\0", kind.as_bytes(), b"\0", key]);
        self.folder.join(format!("{kind}-{}.{ENDING}", &name[..32]))
    }

    /// Removes what was not used for the longest time until the rest fits.
    fn remove_oldest(&self) {
        let now = SystemTime::now();
        let mut kept: Vec<(Duration, u64, PathBuf)> = Vec::new();
        for entry in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let Ok(metadata) = entry.metadata() else { continue };
            if metadata.is_file() && path.extension().is_some_and(|ending| ending == ENDING) {
                // A time that is yet to come is that of a clock that was wrong.
                let used = metadata.modified().ok().filter(|used| *used <= now).unwrap_or(UNIX_EPOCH);
                kept.push((now.duration_since(used).unwrap_or_default(), metadata.len(), path));
            }
        }
        kept.sort();
        let mut bytes = 0_u64;
        for (_, length, path) in kept {
            bytes = bytes.saturating_add(length);
            if bytes > self.most_bytes {
                // Another process may have been faster.
                let _ = fs::remove_file(path);
            }
        }
    }
}

/// Notices damage; no protection against anyone who means harm.
fn checksum(bytes: &[u8]) -> u64 {
    let mut words = bytes.chunks_exact(8);
    let mut sum = 0x9e37_79b9_7f4a_7c15_u64;
    let mut add = |word: [u8; 8]| {
        sum = (sum.rotate_left(5) ^ u64::from_le_bytes(word)).wrapping_mul(0xd134_2543_de82_ef95);
    };
    for word in &mut words {
        add(word.try_into().unwrap_or_default());
    }
    let mut last = [0; 8];
    last[..words.remainder().len()].copy_from_slice(words.remainder());
    add(last);
    sum
}

/// The file of a library within a program of somebody else; see [`count_as_program`].
static PROGRAM_FILE: OnceLock<PathBuf> = OnceLock::new();

/// Lets a library within a program of somebody else, such as an interpreter, count as the program that makes what is kept: its file
/// changes where its code does. To be called before [`Cache::of_user`]; only the first call counts.
pub fn count_as_program(file: PathBuf) {
    // Another file of the same process holds the same code
    let _ = PROGRAM_FILE.set(file);
}

/// The program that runs, or the library that counts as it.
fn running_program() -> Option<String> {
    match PROGRAM_FILE.get() {
        Some(file) => program_of(file),
        None => program_of(&env::current_exe().ok()?),
    }
}

/// Version of this library, and length and time of a program: one that was built anew makes its own.
fn program_of(file: &Path) -> Option<String> {
    let metadata = fs::metadata(file).ok()?;
    let made = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    Some(format!("{} {} {}", env!("CARGO_PKG_VERSION"), metadata.len(), made.as_nanos()))
}

fn user_folder() -> Option<PathBuf> {
    // Paths that are not absolute are to be ignored, says the XDG specification.
    let folder = |name: &str| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let of_user = if cfg!(windows) { folder("LOCALAPPDATA") } else { folder("XDG_CACHE_HOME") };
    of_user
        .or_else(|| Some(folder("HOME")?.join(".cache")))
        .map(|path| path.join("fluorspar"))
        .or_else(temporary)
}

/// A folder in that for temporary files, which is shared: the name is the user's.
#[cfg(unix)]
fn temporary() -> Option<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    Some(env::temp_dir().join(format!("fluorspar-cache-{user}")))
}

#[cfg(not(unix))]
fn temporary() -> Option<PathBuf> {
    Some(env::temp_dir().join("fluorspar-cache"))
}

/// Makes a folder where there is none. `None` if it can't be made, or belongs to somebody else.
#[cfg(unix)]
fn make_own_folder(folder: &Path) -> Option<()> {
    use std::os::unix::fs::{DirBuilderExt, MetadataExt};
    fs::DirBuilder::new().recursive(true).mode(0o700).create(folder).ok()?;
    let metadata = fs::symlink_metadata(folder).ok()?;
    let own = metadata.is_dir() && metadata.uid() == rustix::process::geteuid().as_raw();
    (own && metadata.mode() & 0o022 == 0).then_some(())
}

#[cfg(not(unix))]
fn make_own_folder(folder: &Path) -> Option<()> {
    fs::create_dir_all(folder).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn a_program_that_was_built_anew_is_another() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("program");
        fs::write(&file, "first").unwrap();
        let first = program_of(&file).unwrap();
        assert_eq!(program_of(&file).unwrap(), first);
        fs::write(&file, "second").unwrap();
        assert_ne!(program_of(&file).unwrap(), first);
        assert_eq!(program_of(&folder.path().join("none")), None);
    }

    #[test]
    fn what_was_made_is_found_again_by_the_same_program_and_key() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("deep/cache");
        let cache = Cache::new(at.clone(), 1000, "test 1");
        let make = |cache: &Cache, key: &[u8], made: &[u8]| {
            cache.get_or_make("mesh", key, || Ok::<_, ()>(made.to_vec())).unwrap()
        };
        assert_eq!(make(&cache, b"a", b"one"), b"one");
        assert_eq!(make(&cache, b"a", b"never made"), b"one");
        assert_eq!(make(&cache, b"b", b"two"), b"two");
        assert_eq!(make(&Cache::new(at.clone(), 1000, "test 2"), b"a", b"three"), b"three");
        assert_eq!(cache.get_or_make("mesh", b"c", || Err::<Vec<u8>, _>("no")), Err("no"));
        assert_eq!(count(&at), 3);
    }

    #[test]
    fn damage_is_noticed_and_what_is_damaged_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path().into(), 1000, "test");
        let path = cache.path("mesh", b"a");
        cache.put("mesh", b"a", b"some bytes of a mesh");
        let whole = fs::read(&path).unwrap();
        for byte in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[byte] ^= 4;
            fs::write(&path, &damaged).unwrap();
            assert_eq!(cache.get("mesh", b"a"), None, "byte {byte}");
            assert!(!path.exists());
        }
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            assert_eq!(cache.get("mesh", b"a"), None, "{length} bytes");
        }
        fs::write(&path, &whole).unwrap();
        assert_eq!(cache.get("mesh", b"a").unwrap(), b"some bytes of a mesh");
    }

    #[test]
    fn the_cache_is_bounded_and_what_was_used_last_stays() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path().into(), 1000, "test");
        fs::write(folder.path().join("notes.txt"), [0; 5000]).unwrap();
        let age = |key: &[u8], time: SystemTime| {
            let file = File::options().append(true).open(cache.path("x", key)).unwrap();
            file.set_modified(time).unwrap();
        };
        let now = SystemTime::now();
        for (number, key) in [b"a", b"b", b"c"].into_iter().enumerate() {
            cache.put("x", key, &[7; 250]);
            age(key, now - Duration::from_secs(100 - number as u64));
        }
        assert!(cache.get("x", b"a").is_some());
        cache.put("x", b"d", &[7; 250]);
        // The oldest use is that of b.
        assert!([b"a", b"c", b"d"].iter().all(|key| cache.path("x", *key).exists()));
        assert!(!cache.path("x", b"b").exists());
        // A clock that was wrong keeps nothing for ever.
        age(b"d", now + Duration::from_secs(1_000_000));
        cache.put("x", b"e", &[7; 250]);
        assert!(!cache.path("x", b"d").exists() && cache.path("x", b"e").exists());
        // What is too large is not kept at all, and foreign files stay.
        cache.put("x", b"f", &[7; 501]);
        assert!(!cache.path("x", b"f").exists() && folder.path().join("notes.txt").exists());
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_that_others_may_write_to_is_not_used() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let shared = folder.path().join("shared");
        fs::create_dir(&shared).unwrap();
        fs::set_permissions(&shared, fs::Permissions::from_mode(0o777)).unwrap();
        Cache::new(shared.clone(), 1000, "test").put("x", b"a", b"b");
        assert_eq!(count(&shared), 0);
        fs::write(folder.path().join("file"), "").unwrap();
        let cache = Cache::new(folder.path().join("file/cache"), 1000, "test");
        assert_eq!(cache.get_or_make("x", b"a", || Ok::<_, ()>(b"made".to_vec())), Ok(b"made".to_vec()));
    }
}
