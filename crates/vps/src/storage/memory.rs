//! How much memory this process can still take before the system ends it.

use std::fs;
use std::path::{Path, PathBuf};

/// Bytes that can still be taken, without swapping: the least of what the machine has, of what its
/// control groups leave it, and of its own limits. `None` where nothing of that can be read.
pub fn available_bytes() -> Option<u64> {
    available_in(Path::new("/"))
}

fn available_in(root: &Path) -> Option<u64> {
    let machine =
        text(&root.join("proc/meminfo")).and_then(|text| kib_after(&text, "MemAvailable:"));
    let groups = text(&root.join("proc/self/cgroup"))
        .into_iter()
        .flat_map(|list| left_in_groups(root, &list));
    let own = left_of_own(
        &text(&root.join("proc/self/limits")).unwrap_or_default(),
        &text(&root.join("proc/self/status")).unwrap_or_default(),
    );
    machine.into_iter().chain(groups).chain(own).min()
}

fn text(path: &Path) -> Option<String> {
    fs::read_to_string(path).ok()
}

fn kib_after(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(rest.trim().trim_end_matches("kB").trim().parse::<u64>().ok()?.saturating_mul(1024))
}

/// Names of a control group's files: limit, use, and what of the use is file pages that the kernel
/// gives back.
struct Names {
    limit: &'static str,
    used: &'static str,
    given_back: &'static str,
}

const V2: Names =
    Names { limit: "memory.max", used: "memory.current", given_back: "inactive_file " };
const V1: Names = Names {
    limit: "memory.limit_in_bytes",
    used: "memory.usage_in_bytes",
    given_back: "total_inactive_file ",
};

/// What each control group around this process leaves it: limits of outer groups count as well.
fn left_in_groups(root: &Path, list: &str) -> Vec<u64> {
    let mut left = Vec::new();
    for line in list.lines() {
        let mut fields = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(group)) = (fields.next(), fields.next()) else { continue };
        let (top, names) = match controllers {
            "" => ("sys/fs/cgroup", V2),
            list if list.split(',').any(|name| name == "memory") => ("sys/fs/cgroup/memory", V1),
            _ => continue,
        };
        let top = root.join(top);
        // Seen from within a container the own group is the top one, whatever its path says.
        let own = top.join(group.trim_start_matches('/'));
        let around =
            own.ancestors().take_while(|folder| folder.starts_with(&top)).map(Path::to_owned);
        left.extend(around.filter_map(|folder: PathBuf| {
            let number = |name: &str| text(&folder.join(name))?.trim().parse::<u64>().ok();
            // "max" is no number: no limit.
            let used = number(names.used).unwrap_or(0);
            let stat = text(&folder.join("memory.stat")).unwrap_or_default();
            let given_back = stat
                .lines()
                .find_map(|line| line.strip_prefix(names.given_back)?.trim().parse().ok())
                .unwrap_or(0);
            Some(number(names.limit)?.saturating_sub(used.saturating_sub(given_back)))
        }));
    }
    left
}

/// What `setrlimit` leaves of address space and of data.
fn left_of_own(limits: &str, status: &str) -> impl Iterator<Item = u64> + use<> {
    let left = |limit: &str, used: &str| {
        let soft =
            limits.lines().find_map(|line| line.strip_prefix(limit))?.split_whitespace().next()?;
        Some(soft.parse::<u64>().ok()?.saturating_sub(kib_after(status, used)?))
    };
    [left("Max address space", "VmSize:"), left("Max data size", "VmData:")].into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(files: &[(&str, &str)]) -> Option<u64> {
        let root = tempfile::tempdir().unwrap();
        for (name, contents) in files {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, contents).unwrap();
        }
        available_in(root.path())
    }

    #[test]
    fn the_least_of_all_limits_counts() {
        let meminfo = ("proc/meminfo", "MemTotal:       9000 kB\nMemAvailable:    8000 kB\n");
        assert_eq!(machine(&[]), None);
        assert_eq!(machine(&[meminfo]), Some(8000 << 10));
        let group = ("proc/self/cgroup", "0::/user/run\n");
        let stat = ("sys/fs/cgroup/user/memory.stat", "anon 1\ninactive_file 500\nfile 3\n");
        let outer = ("sys/fs/cgroup/user/memory.max", "2000000\n");
        let used = ("sys/fs/cgroup/user/memory.current", "1500500\n");
        let inner = ("sys/fs/cgroup/user/run/memory.max", "max\n");
        assert_eq!(
            machine(&[meminfo, group, stat, outer, used, inner]),
            Some(500_000),
            "the outer group's limit"
        );
        let tight = ("sys/fs/cgroup/user/run/memory.max", "1000\n");
        assert_eq!(machine(&[meminfo, group, stat, outer, used, tight]), Some(1000));
        let old = ("proc/self/cgroup", "5:cpu:/x\n4:memory,hugetlb:/x\n");
        let limit = ("sys/fs/cgroup/memory/x/memory.limit_in_bytes", "4096\n");
        assert_eq!(machine(&[meminfo, old, limit]), Some(4096));
        let limits = (
            "proc/self/limits",
            "Limit Soft Hard Units\nMax data size unlimited unlimited bytes\nMax address space \
                300000 unlimited bytes\n",
        );
        let status = ("proc/self/status", "VmSize:\t     100 kB\nVmData:\t      50 kB\n");
        assert_eq!(machine(&[meminfo, limits, status]), Some(300_000 - (100 << 10)));
        // A machine that says so has more than nothing.
        assert!(available_bytes().is_none_or(|bytes| bytes > 1 << 20));
    }
}
