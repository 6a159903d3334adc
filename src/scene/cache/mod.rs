//! The bake cache: what generation made of an object, on disk, ready for the tick.
//!
//! ```text
//!  Request ─► recipe ─► key ─► FOLDER/key.bake ──found, sound──► Baked            hit
//!  (mesh bytes, voxel size, …)        │
//!                                     └─ none, other version, damaged ─► bake ─► temporary file ─► fsync ─► rename
//! ```
//!
//! One file per object, named by the hash of everything that its contents depend on. Nothing is
//! ever changed in place: a file appears whole or not at all, whatever kills the process, and two
//! processes that bake the same object write the same bytes. Every byte that is used is covered by
//! a checksum and every index is checked, so that a file that is damaged, cut off or forged is
//! baked anew and replaced. A file of an older version is replaced too; one of a newer version is
//! left alone. The cache never makes a command fail: what went wrong is a
//! [note](Cache::take_notes), and baking goes on without it. Deleting the folder is always safe.
//!
//! Invariant: a scene from the cache is the scene that baking gives, bit for bit. [`GENERATION`]
//! stands for that.

mod contents;
mod folder;
mod request;

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::Instant;

pub use contents::{Baked, read};
pub use request::{Request, Spacing};

pub use vps::part::GENERATION;
use vps::part::{CacheUse, PartRole, Timings};
use vps::storage::sections::{Key, Refusal};
use vps::storage::{MappedFile, regular};

/// Bytes that a cache folder may hold; beyond, the files that were not used for longest go.
const LIMIT_BYTES: u64 = 4 << 30;

/// Where arrays from the cache are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CachePolicy {
    /// In the mapped file: no copy, memory that processes share and that the kernel may take back.
    /// A process that shortens the file ends this one: not for a hand.
    Mapped,
    /// In memory of the process, which no other process can touch: for rendering.
    Copy,
}

/// The bake cache of a command.
#[derive(Debug)]
pub struct Cache {
    /// `None`: off.
    folder: Option<PathBuf>,
    policy: CachePolicy,
    /// One refusal is enough for a process.
    may_write: bool,
    notes: Vec<String>,
}

/// What a look-up found.
#[derive(Debug)]
pub enum Lookup {
    /// The object.
    Hit(Box<Baked>),
    /// Nothing of use: bake it, and give it to [`Cache::store`] with this.
    Bake(CacheSlot),
}

/// The place of an object that is being baked.
#[derive(Debug)]
pub struct CacheSlot {
    /// For the report.
    pub cache: CacheUse,
    /// `None`: do not store.
    key: Option<Key>,
}

impl Cache {
    /// A cache that finds nothing and keeps nothing.
    pub fn off() -> Self {
        Self { folder: None, policy: CachePolicy::Copy, may_write: false, notes: Vec::new() }
    }

    /// The cache in a folder, which need not exist yet.
    pub fn at(folder: PathBuf, policy: CachePolicy) -> Self {
        Self { folder: Some(folder), policy, may_write: true, ..Self::off() }
    }

    /// What a user should know, in plain words; empties the list.
    pub fn take_notes(&mut self) -> Vec<String> {
        core::mem::take(&mut self.notes)
    }

    /// Looks for an object of at most so many bytes. Cost: hashing the mesh file and one pass over
    /// the cache file.
    pub fn look_up(&mut self, request: &Request<'_>, most_bytes: u64) -> Lookup {
        let since = Instant::now();
        // A mesh that cannot be read is refused by the bake, with its cause.
        let Some((folder, key)) = self.folder.as_ref().zip(request.key()) else {
            return Lookup::Bake(CacheSlot { cache: CacheUse::Off, key: None });
        };
        let path = folder::path(folder, &key);
        let refusal = match self.load(&path, key, request.role, most_bytes) {
            Ok(mut baked) => {
                let load = since.elapsed().as_secs_f64();
                request.name.clone_into(&mut baked.report.name);
                baked.report.cache = CacheUse::Hit;
                baked.report.threads = rayon::current_num_threads();
                baked.report.timings_s = Timings { load, total: load, ..Timings::default() };
                return Lookup::Hit(Box::new(baked));
            }
            Err(refusal) => refusal,
        };
        let name = request.name;
        let what = match &refusal {
            Refusal::Io(error)
                if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) =>
            {
                return Lookup::Bake(CacheSlot { cache: CacheUse::Miss, key: Some(key) });
            }
            Refusal::Io(_) => format!("cannot be read ({refusal}): {name} is baked anew"),
            Refusal::Newer { .. } => {
                format!("was {refusal}: {name} is baked anew and the file left alone")
            }
            Refusal::Older { .. } | Refusal::Foreign => {
                format!("was {refusal}: {name} is baked anew and the file replaced")
            }
            Refusal::Damaged(_) => {
                format!("is {refusal}: {name} is baked anew and the file replaced")
            }
        };
        self.notes.push(format!("the cache file {} {what}", path.display()));
        let replace = !matches!(refusal, Refusal::Newer { .. });
        Lookup::Bake(CacheSlot { cache: CacheUse::Rebaked, key: replace.then_some(key) })
    }

    fn load(
        &self,
        path: &Path,
        key: Key,
        role: PartRole,
        most_bytes: u64,
    ) -> Result<Baked, Refusal> {
        let file = regular::open(path)?;
        if file.metadata()?.len() > most_bytes {
            return Err(Refusal::Io(io::Error::new(
                ErrorKind::OutOfMemory,
                "there is no memory left for it",
            )));
        }
        folder::touch(&file);
        let region = match self.policy {
            // An empty file cannot be mapped; a copy of it says what is wrong.
            CachePolicy::Mapped if file.metadata()?.len() > 0 => MappedFile::map(&file)?,
            CachePolicy::Mapped | CachePolicy::Copy => MappedFile::read(&file)?,
        };
        let baked = contents::take(region, Some(key))?;
        if baked.serves(role) { Ok(baked) } else { Err(Refusal::Damaged("its contents")) }
    }

    /// Keeps a baked object. Never fails: what goes wrong is a note.
    pub fn store(&mut self, slot: &CacheSlot, request: &Request<'_>, baked: &Baked) {
        let Some((folder, key)) = self.folder.as_ref().zip(slot.key).filter(|_| self.may_write)
        else {
            return;
        };
        // A mesh file that changed while it was being read may be neither the old one nor the new
        // one.
        if request.key() != Some(key) {
            self.notes.push(format!(
                "the mesh of {} changed while it was baked: it is not kept in the bake cache",
                request.name
            ));
            return;
        }
        if let Err(error) =
            folder::write(folder, &key, LIMIT_BYTES, |file| baked.write_to(key, file))
        {
            self.may_write = false;
            self.notes.push(format!(
                "the bake cache {} cannot be written ({error}): nothing is kept for the next \
                    start; {}choose another folder with --cache DIR, or use --cache off",
                folder.display(),
                remedy(error.kind())
            ));
        }
    }
}

/// What would let the same folder be written, followed by "or"; nothing where that is not known.
fn remedy(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "make room, ",
        ErrorKind::PermissionDenied => "give this user the right to write there, ",
        ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
            "move away the file that stands where the folder should be, "
        }
        ErrorKind::IsADirectory => "move away the folder that stands where the file should be, ",
        _ => "",
    }
}
