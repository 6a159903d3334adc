//! Which arms are attached, and what stands in their way.
//!
//! Data in: the [nodes](super::nodes) of the machine, the arms that profiles know, and the files
//! below a [`Root`]. Data out: [`AttachedNode`] nodes, and [`Finding`]s with what to type. Nothing
//! is opened and nothing is changed.

use std::fs;
use std::path::{Path, PathBuf};

use super::nodes::{DeviceFile, NodeKind};
use crate::guard;
use crate::profile::{self, Match, Profile, UsbId};
use rt::finding::{Finding, Root};

/// The shipped udev rules.
pub const UDEV_RULES: &str = include_str!("../../devices/udev/70-hapticd.rules");
/// Name of their file.
const UDEV_RULES_NAME: &str = "70-hapticd.rules";
/// Where udev looks for rules, the first place first.
const UDEV_FOLDERS: [&str; 4] =
    ["/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d"];

/// What to type to install the rules.
const UDEV_ADVICE: &str = "hapticd doctor --udev-rules | sudo tee \
    /etc/udev/rules.d/70-hapticd.rules && sudo udevadm control --reload && sudo udevadm \
    trigger   # then unplug the arm and plug it in again";

/// An arm that some profile describes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KnownArm {
    /// Name of the profile.
    pub profile: String,
    /// Name for people.
    pub title: String,
    /// What its node must be.
    pub matching: Match,
}

impl KnownArm {
    fn of(profile: &Profile) -> Option<Self> {
        let matching = profile.real.as_ref()?.matching.clone();
        Some(Self { profile: profile.name.clone(), title: profile.title.clone(), matching })
    }

    /// The node belongs to such a device, but is another of its interfaces.
    fn is_beside(&self, node: &DeviceFile) -> bool {
        let is_of_device =
            |id: &UsbId| (id.vendor, id.product) == (node.vendor_id, node.product_id);
        self.matching.ids.iter().any(is_of_device) && !self.matching.has_form_of(node)
    }
}

/// Every arm that a shipped profile describes.
pub fn known_arms() -> Vec<KnownArm> {
    let profiles = profile::names().filter_map(|name| profile::find(name, Path::new("")).ok());
    profiles.filter_map(|profile| KnownArm::of(&profile)).collect()
}

/// What is to be said of the arm that a scene names, where neither a library nor a service of its
/// maker drives it.
pub fn scene_arm(profile: &Profile, is_attached: bool) -> Option<Finding> {
    if is_attached {
        return None;
    }
    match KnownArm::of(profile) {
        None => Some(Finding::good("arm", format!("{}: simulated, needs no link", profile.name))),
        Some(arm) => Some(
            Finding::bad(
                "arm",
                format!(
                    "{} ({}) is not attached, or has other numbers than its profile says",
                    arm.title, arm.profile
                ),
                "plug it in and switch it on, then: hapticd devices",
            )
            .by_hand(),
        ),
    }
}

/// A program that has a node open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Number of the process.
    pub pid: u32,
    /// Its name.
    pub name: String,
}

/// A node and what is known of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachedNode {
    /// The node.
    pub node: DeviceFile,
    /// This user may read and write it.
    pub permitted: bool,
    /// Programs that have it open, as far as this user may see.
    pub holders: Vec<Holder>,
    /// Profiles that it fits.
    pub profiles: Vec<String>,
    /// Profiles of the device that it is another interface of.
    pub beside: Vec<String>,
}

/// Looks at every node. `may_use`: whether this user may read and write a path.
pub fn attached(
    nodes: Vec<DeviceFile>,
    known: &[KnownArm],
    root: &Root,
    may_use: impl Fn(&Path) -> bool,
) -> Vec<AttachedNode> {
    let names = |fits: &dyn Fn(&KnownArm) -> bool| -> Vec<String> {
        known.iter().filter(|arm| fits(arm)).map(|arm| arm.profile.clone()).collect()
    };
    let look = |node: DeviceFile| AttachedNode {
        permitted: may_use(&node.path),
        holders: holders(root, &node.path),
        profiles: names(&|arm| arm.matching.admits(&node)),
        beside: names(&|arm| arm.is_beside(&node)),
        node,
    };
    nodes.into_iter().map(look).collect()
}

/// True when this user may read and write the node.
pub fn may_use(path: &Path) -> bool {
    rustix::fs::access(path, rustix::fs::Access::READ_OK | rustix::fs::Access::WRITE_OK).is_ok()
}

/// Processes that have a node open: those whose descriptors this user may see.
pub(super) fn holders(root: &Root, node: &Path) -> Vec<Holder> {
    let own = std::process::id();
    let pids = root.names("/proc").into_iter().filter_map(|name| name.parse::<u32>().ok());
    let mut holders: Vec<Holder> = pids
        .filter(|pid| *pid != own)
        .filter(|pid| {
            let folder = root.join(format!("/proc/{pid}/fd"));
            let Ok(entries) = fs::read_dir(folder) else { return false };
            entries
                .flatten()
                .any(|entry| fs::read_link(entry.path()).is_ok_and(|target| target == node))
        })
        .map(|pid| Holder {
            pid,
            name: root.read(format!("/proc/{pid}/comm")).unwrap_or_else(|| "?".to_owned()),
        })
        .collect();
    // A guard goes with the process that it guards, and heeds no signal.
    holders.retain(|holder| holder.name != guard::NAME);
    holders.sort_by_key(|holder| holder.pid);
    holders
}

/// Whether the udev rules are where udev finds them.
pub fn udev(root: &Root) -> Finding {
    for folder in UDEV_FOLDERS {
        let path = Path::new(folder).join(UDEV_RULES_NAME);
        match root.read(&path) {
            Some(text) if text == UDEV_RULES.trim() => {
                return Finding::good("udev rules", path.display().to_string());
            }
            Some(_) => {
                let found = format!("{} differs from the rules of this version", path.display());
                return Finding::advice("udev rules", found, UDEV_ADVICE);
            }
            None => {}
        }
    }
    Finding::advice("udev rules", "not installed: only root may open most arms", UDEV_ADVICE)
}

/// Whether ModemManager would talk to serial arms.
pub fn modem_manager(root: &Root) -> Finding {
    let runs = root.names("/proc").iter().any(|pid| {
        pid.bytes().all(|byte| byte.is_ascii_digit())
            && root.read(format!("/proc/{pid}/comm")).as_deref() == Some("ModemManager")
    });
    let has_rules = UDEV_FOLDERS.iter().any(|folder| {
        root.read(Path::new(folder).join(UDEV_RULES_NAME))
            .is_some_and(|text| text.contains("ID_MM_DEVICE_IGNORE"))
    });
    match (runs, has_rules) {
        (false, _) => Finding::good("ModemManager", "does not run"),
        (true, true) => {
            Finding::good("ModemManager", "runs, and the udev rules keep it off known arms")
        }
        (true, false) => Finding::bad(
            "ModemManager",
            "runs and talks to every new serial port: an arm seems to lose bytes at its start",
            format!(
                "{UDEV_ADVICE}\nsudo systemctl disable --now ModemManager   # instead, if no modem \
                    is in use"
            ),
        ),
    }
}

/// What stands in the way of one node that fits a profile, or that the user named.
pub fn findings(attached: &AttachedNode, root: &Root) -> Vec<Finding> {
    let node = &attached.node;
    let path = node.path.display();
    let mut findings = Vec::new();
    if !attached.profiles.is_empty() {
        findings.push(Finding::good("arm", format!("{path}: {}", attached.profiles.join(", "))));
    } else if !attached.beside.is_empty() {
        let found = format!(
            "{path} is another interface of {}, which does not carry its reports",
            attached.beside.join(", ")
        );
        let advice = "choose by VID:PID in [device] selector rather than by this path";
        findings.push(Finding::advice("interface", found, advice).by_hand());
        return findings;
    }
    findings.push(if attached.permitted {
        Finding::good("permission", format!("{path} may be read and written"))
    } else {
        let group = format!("\nsudo chmod a+rw {path}   # instead, for now");
        Finding::bad(
            "permission",
            format!("{path} may not be opened by this user"),
            format!("{UDEV_ADVICE}{group}"),
        )
    });
    match attached.holders.as_slice() {
        [] => findings.push(Finding::good(
            "holder",
            format!("no other process has {path} open, as far as this user sees"),
        )),
        holders => {
            let names: Vec<String> = holders
                .iter()
                .map(|holder| format!("{} (process {})", holder.name, holder.pid))
                .collect();
            let stop: Vec<String> =
                holders.iter().map(|holder| format!("kill {}", holder.pid)).collect();
            let found = format!("{path} is open in {}", names.join(", "));
            findings.push(Finding::bad(
                "holder",
                found,
                format!("{}   # or end that program as it wants to be ended", stop.join("; ")),
            ));
        }
    }
    findings.extend(latency_timer(node, root));
    findings.extend(autosuspend(node, root));
    findings
}

/// FTDI adapters collect bytes for 16 ms unless reported otherwise.
fn latency_timer(node: &DeviceFile, root: &Root) -> Option<Finding> {
    let name = node.path.file_name()?.to_str()?;
    let file = format!("/sys/bus/usb-serial/devices/{name}/latency_timer");
    let latency_ms: u32 = root.read(&file)?.parse().ok()?;
    Some(if latency_ms <= 1 {
        Finding::good("latency timer", format!("{latency_ms} ms"))
    } else {
        Finding::bad(
            "latency timer",
            format!("{latency_ms} ms: no more than {} replies per second", 1000 / latency_ms),
            format!("echo 1 | sudo tee {file}"),
        )
    })
}

/// A bus that goes to sleep under an arm takes milliseconds to wake.
fn autosuspend(node: &DeviceFile, root: &Root) -> Option<Finding> {
    let name = node.path.file_name()?.to_str()?;
    let class = match node.kind {
        NodeKind::Hid => "hidraw",
        NodeKind::Serial => "tty",
    };
    let device = usb_device(&root.join(format!("/sys/class/{class}/{name}/device")))?;
    let file = device.join("power/control");
    let control = fs::read_to_string(&file).ok()?;
    Some(if control.trim() == "on" {
        Finding::good("USB autosuspend", "off")
    } else {
        let found = format!("{}: the bus may sleep under the arm", control.trim());
        Finding::advice("USB autosuspend", found, format!("echo on | sudo tee {}", file.display()))
    })
}

/// The USB device that a class device belongs to: the nearest folder above with a vendor.
pub(super) fn usb_device(device: &Path) -> Option<PathBuf> {
    let mut folder = fs::canonicalize(device).ok()?;
    loop {
        if folder.join("idVendor").is_file() {
            return Some(folder);
        }
        if !folder.pop() {
            return None;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;
    use crate::profile::TransportKind;
    use rt::finding::{Standing, tree};

    fn raw_hid() -> DeviceFile {
        DeviceFile {
            vendor_id: 0x16c0,
            product_id: 0x0486,
            interface: Some(0),
            usages: vec![(0xffab, 0x0200)],
            ..DeviceFile::at(Path::new("/dev/hidraw3"))
        }
    }

    fn known() -> Vec<KnownArm> {
        vec![KnownArm {
            profile: "polhem-2019".to_owned(),
            title: "Polhem".to_owned(),
            matching: Match {
                transport: TransportKind::Hid,
                ids: vec![UsbId { vendor: 0x16c0, product: 0x0486 }],
                usage_page: Some(0xffab),
                usage: None,
                interface: None,
                serial: None,
                product: None,
                by_id: None,
                baud: 115_200,
            },
        }]
    }

    #[test]
    fn nodes_are_known_by_their_profile_and_their_holder_by_name() {
        let (_folder, root) = tree(&[("/proc/42/comm", "spacenavd\n"), ("/proc/7/comm", "bash\n")]);
        fs::create_dir_all(root.join("/proc/42/fd")).expect("folder");
        symlink("/dev/hidraw3", root.join("/proc/42/fd/5")).expect("link");
        fs::create_dir_all(root.join("/proc/43/fd")).expect("folder");
        fs::write(root.join("/proc/43/comm"), "haptic-guard\n").expect("written");
        symlink("/dev/hidraw3", root.join("/proc/43/fd/1")).expect("link");
        let emulated = DeviceFile {
            usages: vec![(0xffc9, 4)],
            interface: Some(1),
            path: "/dev/hidraw4".into(),
            ..raw_hid()
        };
        let found = attached(
            vec![raw_hid(), emulated, DeviceFile::at(Path::new("/dev/ttyS0"))],
            &known(),
            &root,
            |path| path != Path::new("/dev/hidraw3"),
        );
        assert_eq!(
            (found[0].profiles.as_slice(), found[0].permitted),
            (&["polhem-2019".to_owned()][..], false)
        );
        assert_eq!(found[0].holders, [Holder { pid: 42, name: "spacenavd".to_owned() }]);
        assert_eq!(
            (found[1].profiles.len(), found[1].beside.as_slice()),
            (0, &["polhem-2019".to_owned()][..])
        );
        assert!(found[2].profiles.is_empty() && found[2].beside.is_empty() && found[2].permitted);

        let rows = findings(&found[0], &root);
        let row = |name: &str| rows.iter().find(|row| row.name == name).expect(name);
        assert!(
            row("permission").standing == Standing::Bad
                && row("permission").advice.contains("70-hapticd.rules")
        );
        assert!(
            row("holder").found.contains("spacenavd (process 42)")
                && row("holder").advice.contains("kill 42")
        );
        assert!(findings(&found[1], &root)[0].found.contains("another interface of polhem-2019"));
    }

    #[test]
    fn adapters_and_buses_that_wait_are_reported() {
        let node = DeviceFile::at(Path::new("/dev/ttyUSB0"));
        let files = [
            ("/sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n"),
            ("/sys/devices/usb1/1-2/idVendor", "0403\n"),
            ("/sys/devices/usb1/1-2/power/control", "auto\n"),
            ("/sys/devices/usb1/1-2/1-2:1.0/ttyUSB0/uevent", ""),
            ("/sys/class/tty/ttyUSB0/uevent", ""),
        ];
        let (_folder, root) = tree(&files);
        symlink(
            root.join("/sys/devices/usb1/1-2/1-2:1.0/ttyUSB0"),
            root.join("/sys/class/tty/ttyUSB0/device"),
        )
        .expect("link");
        let attached = attached(vec![node], &[], &root, |_| true).remove(0);
        let rows = findings(&attached, &root);
        let row = |name: &str| rows.iter().find(|row| row.name == name).expect(name);
        assert!(
            row("latency timer").found.contains("62 replies")
                && row("latency timer").advice.contains("echo 1 | sudo tee /sys/bus")
        );
        assert!(
            row("USB autosuspend").found.starts_with("auto")
                && row("USB autosuspend").advice.contains("1-2/power/control")
        );
        fs::write(root.join("/sys/bus/usb-serial/devices/ttyUSB0/latency_timer"), "1\n")
            .expect("written");
        fs::write(root.join("/sys/devices/usb1/1-2/power/control"), "on\n").expect("written");
        assert!(findings(&attached, &root).iter().all(|row| row.standing == Standing::Good));
    }

    #[test]
    fn rules_and_the_modem_manager_are_looked_for() {
        let (_folder, bare) = tree(&[("/proc/9/comm", "ModemManager\n")]);
        assert_eq!(
            (udev(&bare).standing, modem_manager(&bare).standing),
            (Standing::Advice, Standing::Bad)
        );
        let (_folder, installed) = tree(&[
            ("/etc/udev/rules.d/70-hapticd.rules", UDEV_RULES),
            ("/proc/9/comm", "ModemManager\n"),
        ]);
        assert_eq!(
            (udev(&installed).standing, modem_manager(&installed).standing),
            (Standing::Good, Standing::Good)
        );
        let (_folder, old) = tree(&[("/usr/lib/udev/rules.d/70-hapticd.rules", "# old\n")]);
        assert!(
            udev(&old).found.contains("differs") && modem_manager(&old).standing == Standing::Good
        );
    }

    #[test]
    fn the_rules_name_every_usb_arm_of_the_device_reference() {
        for ids in [
            "1234", "0006", "16c0", "0486", "0483", "0403", "cb48", "256f", "046d", "2988", "1209",
            "ffb0",
        ] {
            assert!(UDEV_RULES.contains(&format!("\"{ids}\"")), "{ids}");
        }
        // uaccess is applied by rule 73, so the file has to come before it.
        assert!(UDEV_RULES_NAME < "73");
    }

    /// True when a pattern of udev fits: characters, or some of them in brackets.
    fn fits(pattern: &str, text: &str) -> bool {
        let mut pattern = pattern.chars();
        let mut text = text.chars();
        loop {
            match (pattern.next(), text.next()) {
                (None, None) => return true,
                (Some('['), Some(found)) => {
                    let any_of: String =
                        pattern.by_ref().take_while(|wanted| *wanted != ']').collect();
                    if !any_of.contains(found) {
                        return false;
                    }
                }
                (wanted, found) if wanted == found => {}
                _ => return false,
            }
        }
    }

    #[test]
    fn the_udev_rules_admit_every_shipped_arm() {
        let value = |line: &str, key: &str| {
            let (_, rest) = line.split_once(&format!("{key}}}==\""))?;
            rest.split_once('"').map(|(value, _)| value.to_owned())
        };
        let admits = |kind: &str, id: &UsbId| {
            UDEV_RULES
                .lines()
                .filter(|line| line.starts_with(kind) && line.contains("uaccess"))
                .any(|line| {
                    value(line, "idVendor")
                        .is_some_and(|vendor| fits(&vendor, &format!("{:04x}", id.vendor)))
                        && value(line, "idProduct")
                            .is_none_or(|product| fits(&product, &format!("{:04x}", id.product)))
                })
        };
        let mut n_ids = 0;
        for arm in known_arms() {
            let kind = match arm.matching.transport {
                TransportKind::Hid => "KERNEL==\"hidraw*\"",
                TransportKind::Serial => "SUBSYSTEM==\"tty\"",
                TransportKind::Usb => "SUBSYSTEM==\"usb\"",
                TransportKind::Socket | TransportKind::Service | TransportKind::Library => continue,
            };
            for id in &arm.matching.ids {
                assert!(admits(kind, id), "{}: {:04x}:{:04x}", arm.profile, id.vendor, id.product);
                n_ids += 1;
            }
        }
        assert!(n_ids > 10, "{n_ids}");
    }
}
