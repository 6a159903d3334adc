//! The bake cache on the command line: where it is, and what it has to say.

use std::path::PathBuf;

use super::memory::MemoryRule;
use super::progress::BakeProgress;
use super::{OutputOptions, output, report};
use crate::scene::BakeOptions;
use crate::scene::cache::{Cache, CachePolicy};

/// Where baked objects are kept.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct CacheArgs {
    /// Folder of the bake cache, or `off` [default: $XDG_CACHE_HOME/hapticd, or ~/.cache/hapticd].
    #[arg(long, value_name = "DIR|off")]
    cache: Option<PathBuf>,
}

impl CacheArgs {
    /// No cache.
    pub(crate) fn off() -> Self {
        Self { cache: Some("off".into()) }
    }

    /// Turned off on the command line.
    pub(crate) fn is_off(&self) -> bool {
        self.cache.as_ref().is_some_and(|folder| folder.as_os_str() == "off")
    }

    /// The cache that is asked for, or the user's own.
    pub(crate) fn open(&self, policy: CachePolicy, output: OutputOptions) -> Cache {
        if self.is_off() {
            return Cache::off();
        }
        let folder = match &self.cache {
            Some(folder) => Some(folder.clone()),
            None => {
                if let Some(relative) = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from)
                    && relative.is_relative()
                    && !relative.as_os_str().is_empty()
                {
                    let message = format!(
                        "XDG_CACHE_HOME is ignored, as {} is not an absolute path",
                        relative.display()
                    );
                    report::warning(&message, output);
                }
                user_folder()
            }
        };
        if let Some(folder) = folder {
            return Cache::at(folder, policy);
        }
        if output.verbose > 0 {
            output::message(format_args!(
                "bake cache: off, as neither XDG_CACHE_HOME nor HOME names a folder\n"
            ));
        }
        Cache::off()
    }
}

/// As the XDG base directory specification has it: relative paths are ignored.
fn user_folder() -> Option<PathBuf> {
    let folder =
        |variable| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    folder("XDG_CACHE_HOME")
        .or_else(|| Some(folder("HOME")?.join(".cache")))
        .map(|folder| folder.join("hapticd"))
}

impl CacheArgs {
    /// Bakes through the cache: shows how the work goes, and says what the cache has to say.
    pub(crate) fn bake<T>(
        &self,
        policy: CachePolicy,
        memory: MemoryRule<'_>,
        output: OutputOptions,
        work: impl FnOnce(&mut BakeOptions<'_>, &BakeProgress) -> T,
    ) -> T {
        let mut cache = self.open(policy, output);
        let progress = BakeProgress::new(output);
        let mut options = BakeOptions { cache: &mut cache, memory: memory.plan(&progress, output) };
        let done = work(&mut options, &progress);
        drop(options);
        drop(progress);
        tell(&mut cache, output);
        done
    }
}

/// Prints what the cache has to say.
pub(crate) fn tell(cache: &mut Cache, output: OutputOptions) {
    for note in cache.take_notes() {
        report::warning(&note, output);
    }
}
