//! Libraries and services of arms' makers: which are here, and what stands in the way of each, by
//! the traps that are known of it.
//!
//! Data in: the files below a [`Root`], the environment, and what this user may open. Data out:
//! [`Finding`]s. Nothing is loaded, opened or changed.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use super::discover::{self, AttachedNode, Holder, holders, usb_device};
use super::nodes::{DeviceFile, NodeKind};
use crate::profile::{self, Profile};
use crate::protocol::haply::{Dialect, HaplyService};
use crate::protocol::{Protocol, StartError};
use crate::transport::{RunningService, running_service};
use crate::vendor::{Family, Need, VIRTUOSE_PORT, VendorProtocol, unsuitable_file};
use rt::finding::{Finding, Root};
use vps::storage::regular;

/// What is looked at.
#[derive(Clone, Copy)]
pub struct SystemView<'m> {
    /// Its files.
    pub root: &'m Root,
    /// A variable of the environment.
    pub variable: &'m dyn Fn(&str) -> Option<OsString>,
    /// Whether this user may read and write a path.
    pub may_use: &'m dyn Fn(&Path) -> bool,
}

/// A maker whose library is here, or one of whose arms is plugged in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MakersLibrary {
    /// Whose.
    pub family: Family,
    /// The library that would be loaded.
    pub path: Option<PathBuf>,
    /// USB devices of the maker, as `VVVV:PPPP name`.
    pub plugged: Vec<String>,
    /// Profiles of its arms.
    pub profiles: Vec<String>,
}

/// Oldest version of Force Dimension's library that the driver was written for.
const DHD_MIN: (u32, u32) = (3, 16);
/// Bytes of a library at most, ten times the largest that is known: what is longer is taken to need
/// nothing.
const LIBRARY_BYTES_MAX: u64 = 256 << 20;
/// Where the system looks for libraries; `MACHINE` is that of this program.
const SYSTEM_FOLDERS: [&str; 8] = [
    "/lib",
    "/lib64",
    "/usr/lib",
    "/usr/lib64",
    "/usr/local/lib",
    "/lib/MACHINE-linux-gnu",
    "/usr/lib/MACHINE-linux-gnu",
    "/usr/local/lib/MACHINE-linux-gnu",
];
/// Folders of older and newer drivers of 3D Systems, where `GTDD_HOME` names none.
const TOUCH_FOLDERS: [&str; 2] = ["~/.3dsystems", "/usr/share/3DSystems"];
/// The name of an arm that its setup gave none.
const TOUCH_NAME: &str = "Default Device";
const TOUCH_SETUP: &str = "run the maker's setup (Touch_Setup, or Touch_AdvancedConfig) as this \
    user, without sudo, with the arm plugged in";

impl SystemView<'_> {
    /// A variable that says something.
    fn variable(&self, name: &str) -> Option<PathBuf> {
        (self.variable)(name).filter(|value| !value.is_empty()).map(PathBuf::from)
    }

    /// The library of a family that would be loaded.
    fn library(&self, family: Family, written: Option<&Path>) -> Result<PathBuf, Vec<PathBuf>> {
        let places = family.absolute_places(written, self.variable);
        places.iter().find(|path| self.root.join(path).exists()).cloned().ok_or(places)
    }

    /// USB devices of a family: their folders, and what they are called.
    fn plugged(&self, family: Family) -> Vec<(String, String)> {
        let folder = "/sys/bus/usb/devices";
        let look = |name: String| {
            let read = |file: &str| self.root.read(format!("{folder}/{name}/{file}"));
            let vendor = read("idVendor")?;
            let product = read("idProduct")?;
            let number = |text: &str| u16::from_str_radix(text, 16).ok();
            let title = format!("{vendor}:{product} {}", read("product").unwrap_or_default());
            family
                .has_usb(number(&vendor)?, number(&product)?)
                .then(|| (format!("{folder}/{name}"), title.trim_end().to_owned()))
        };
        self.root.names(folder).into_iter().filter_map(look).collect()
    }

    /// Nodes that the library of a family opens.
    fn nodes(&self, family: Family) -> Vec<DeviceFile> {
        match family {
            Family::Virtuose => Vec::new(),
            Family::ForceDimension => {
                let number = |folder: &str, file: &str| {
                    self.root.read(format!("{folder}/{file}"))?.parse::<u32>().ok()
                };
                let path = |(folder, _): (String, String)| {
                    let bus = number(&folder, "busnum")?;
                    let device = number(&folder, "devnum")?;
                    Some(PathBuf::from(format!("/dev/bus/usb/{bus:03}/{device:03}")))
                };
                self.plugged(family)
                    .into_iter()
                    .filter_map(path)
                    .map(|path| DeviceFile::at(&path))
                    .collect()
            }
            Family::OpenHaptics => ["tty", "hidraw"]
                .into_iter()
                .flat_map(|class| self.nodes_of_class(family, class))
                .collect(),
        }
    }

    fn nodes_of_class(&self, family: Family, class: &str) -> Vec<DeviceFile> {
        let is_of_family = |name: &String| {
            let number = |folder: &Path, file: &str| {
                u16::from_str_radix(regular::written(&folder.join(file)).ok()?.trim(), 16).ok()
            };
            let device = usb_device(&self.root.join(format!("/sys/class/{class}/{name}/device")))?;
            Some(family.has_usb(number(&device, "idVendor")?, number(&device, "idProduct")?))
        };
        let names = self.root.names(format!("/sys/class/{class}")).into_iter();
        names
            .filter(|name| is_of_family(name) == Some(true))
            .map(|name| DeviceFile::at(&Path::new("/dev").join(name)))
            .collect()
    }

    /// Every folder in which the system looks for a library.
    fn library_folders(&self) -> Vec<PathBuf> {
        let mut folders: Vec<PathBuf> = self
            .variable("LD_LIBRARY_PATH")
            .iter()
            .flat_map(std::env::split_paths)
            .filter(|path| path.is_absolute())
            .collect();
        folders.extend(
            SYSTEM_FOLDERS
                .iter()
                .map(|folder| folder.replace("MACHINE", std::env::consts::ARCH).into()),
        );
        for name in self.root.names("/etc/ld.so.conf.d") {
            let text = self.root.read(format!("/etc/ld.so.conf.d/{name}")).unwrap_or_default();
            folders.extend(
                text.lines()
                    .filter(|line| line.starts_with('/'))
                    .map(|line| PathBuf::from(line.trim())),
            );
        }
        folders
    }
}

/// Looks for the libraries of makers and for what such a library would open.
pub fn makers_libraries(machine: &SystemView<'_>) -> Vec<MakersLibrary> {
    let profiles: Vec<Profile> =
        profile::names().filter_map(|name| profile::find(name, Path::new("")).ok()).collect();
    let look = |family: Family| {
        let is_of_family =
            |profile: &&Profile| vendor_of(profile).is_some_and(|vendor| vendor.family == family);
        MakersLibrary {
            family,
            path: machine.library(family, None).ok(),
            plugged: machine.plugged(family).into_iter().map(|(_, title)| title).collect(),
            profiles: profiles
                .iter()
                .filter(is_of_family)
                .map(|profile| profile.name.clone())
                .collect(),
        }
    };
    Family::ALL
        .into_iter()
        .map(look)
        .filter(|found| found.path.is_some() || !found.plugged.is_empty())
        .collect()
}

/// What a profile says of the library that its arm needs.
fn vendor_of(profile: &Profile) -> Option<&VendorProtocol> {
    match &profile.real.as_ref()?.protocol {
        Protocol::Vendor(vendor) => Some(vendor),
        _ => None,
    }
}

/// What stands in the way of an arm that a library or a service of its maker drives; `None` for
/// other arms.
pub fn arm_findings(machine: &SystemView<'_>, profile: &Profile) -> Option<Vec<Finding>> {
    let real = profile.real.as_ref()?;
    match &real.protocol {
        Protocol::Vendor(vendor) => Some(findings(
            machine,
            vendor.family,
            vendor.library.as_deref(),
            real.matching.serial.as_deref(),
        )),
        Protocol::HaplyService(service) => Some(vec![service_finding(service)]),
        _ => None,
    }
}

/// What stands in the way of the library of a maker. `written`: where a profile says that it is.
/// `serial`: which arm is meant, as the maker counts.
pub fn findings(
    machine: &SystemView<'_>,
    family: Family,
    written: Option<&Path>,
    serial: Option<&str>,
) -> Vec<Finding> {
    let name = "maker's library";
    let mut findings = Vec::new();
    match machine.library(family, written) {
        Err(places) => {
            let found = format!("{family}: {}", family.missing_text(&places));
            findings.push(Finding::bad(name, found, family.missing_advice(&places)).by_hand());
        }
        Ok(path) => {
            let file = machine.root.join(&path);
            match unsuitable_file(&file) {
                Some(why) => {
                    let found = format!("{family}: {} {why}", path.display());
                    findings.push(
                        Finding::bad(
                            name,
                            found,
                            format!("take the library out of the {}", family.title()),
                        )
                        .by_hand(),
                    );
                }
                None => {
                    findings.push(Finding::good(name, format!("{family}: {}", path.display())));
                    findings.extend(missing_needs(machine, family, &file));
                    if family == Family::ForceDimension {
                        findings.extend(dhd(&file));
                    }
                }
            }
        }
    }
    let nodes = machine.nodes(family);
    for node in &nodes {
        let permitted = (machine.may_use)(&node.path);
        let holders = holders(machine.root, &node.path);
        let attached = AttachedNode {
            node: node.clone(),
            permitted,
            holders,
            profiles: vec![family.name().to_owned()],
            beside: Vec::new(),
        };
        // Who has an arm of 3D Systems is reported below, with other advice.
        let is_reported =
            |finding: &Finding| family != Family::OpenHaptics || finding.name != "holder";
        findings
            .extend(discover::findings(&attached, machine.root).into_iter().filter(is_reported));
    }
    match family {
        Family::ForceDimension => {}
        Family::OpenHaptics => {
            let folder = touch_folder(machine);
            findings.push(touch_configuration(machine, folder.as_deref(), serial));
            findings.extend(touch_port(machine, folder.as_deref(), serial, &nodes));
            findings.push(touch_lock(machine, &nodes));
        }
        Family::Virtuose => findings.extend(virtuose_service(machine, serial)),
    }
    findings
}

/// What a library rests on and is not here. Its own file names it, and so do those that it rests
/// on.
fn missing_needs(machine: &SystemView<'_>, family: Family, library: &Path) -> Vec<Finding> {
    let folders = machine.library_folders();
    let mut missing: Vec<&Need> = Vec::new();
    let mut files = vec![library.to_owned()];
    let mut known: Vec<&str> = Vec::new();
    while let Some(file) = files.pop() {
        let bytes = regular::bytes(&file, LIBRARY_BYTES_MAX).unwrap_or_default();
        for need in family.needs().iter().filter(|need| names(&bytes, need.file)) {
            if known.contains(&need.file) {
                continue;
            }
            known.push(need.file);
            match folders
                .iter()
                .map(|folder| machine.root.join(folder.join(need.file)))
                .find(|path| path.exists())
            {
                Some(path) => files.push(path),
                None => missing.push(need),
            }
        }
    }
    let reported = |need: &Need| {
        let finding = Finding::bad(
            need.title,
            format!("{}, which the library needs, is not installed", need.file),
            need.advice,
        );
        if need.by_hand { finding.by_hand() } else { finding }
    };
    missing.into_iter().map(reported).collect()
}

/// A library holds the names of those that it needs, each with a zero byte behind it.
fn names(bytes: &[u8], file: &str) -> bool {
    let wanted = [file.as_bytes(), b"\0"].concat();
    bytes.windows(wanted.len()).any(|some| some == wanted)
}

/// Version and kind of Force Dimension's library, by the name of its file.
fn dhd(file: &Path) -> Vec<Finding> {
    let file = fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut findings = Vec::new();
    if name.starts_with("libdhd.") {
        let found = format!("{name} cannot let an arm find its zero (`--home`)");
        findings.push(
            Finding::advice("homing", found, "take libdrd of the same kit: it holds all of libdhd")
                .by_hand(),
        );
    }
    let numbers: Vec<u32> = name.split_once(".so.").map_or(Vec::new(), |(_, rest)| {
        rest.split('.').filter_map(|word| word.parse().ok()).collect()
    });
    if let [major, minor, ..] = numbers[..]
        && (major, minor) < DHD_MIN
    {
        let found = format!(
            "{name} is version {major}.{minor}; the driver was written for {}.{} and later",
            DHD_MIN.0, DHD_MIN.1
        );
        findings.push(
            Finding::advice(
                "version",
                found,
                format!("install the {}", Family::ForceDimension.title()),
            )
            .by_hand(),
        );
    }
    findings
}

/// The folder of the setup of 3D Systems: that of `GTDD_HOME`, or one that has a configuration.
fn touch_folder(machine: &SystemView<'_>) -> Option<PathBuf> {
    machine.variable("GTDD_HOME").or_else(|| {
        let home = machine.variable("HOME").unwrap_or_default();
        let folders = TOUCH_FOLDERS.iter().map(|folder| {
            folder.strip_prefix("~/").map_or_else(|| folder.into(), |below| home.join(below))
        });
        folders
            .filter(|folder: &PathBuf| folder.is_absolute())
            .find(|folder| !touch_names(machine, folder).is_empty())
    })
}

/// Arms that the setup has written a configuration of.
fn touch_names(machine: &SystemView<'_>, folder: &Path) -> Vec<String> {
    let names = machine.root.names(folder.join("config")).into_iter();
    names.filter_map(|name| name.strip_suffix(".config").map(str::to_owned)).collect()
}

/// Whether the library finds what the setup has written.
fn touch_configuration(
    machine: &SystemView<'_>,
    folder: Option<&Path>,
    serial: Option<&str>,
) -> Finding {
    let name = "configuration folder";
    let is_named = machine.variable("GTDD_HOME").is_some();
    let Some(folder) = folder else {
        let found =
            format!("GTDD_HOME is not set, and there is none in {}", TOUCH_FOLDERS.join(" or "));
        let sudo = if machine.variable("SUDO_USER").is_some() {
            "; sudo takes GTDD_HOME away: sudo --preserve-env=GTDD_HOME keeps it"
        } else {
            ""
        };
        return Finding::bad(name, format!("{found}{sudo}"), TOUCH_SETUP).by_hand();
    };
    let shown = folder.join("config").display().to_string();
    let names = touch_names(machine, folder);
    let wanted = serial.unwrap_or(TOUCH_NAME);
    if names.is_empty() {
        return Finding::bad(
            name,
            format!("{shown} holds no configuration (*.config)"),
            TOUCH_SETUP,
        )
        .by_hand();
    }
    if !names.iter().any(|name| name == wanted) {
        let found = format!("{shown} knows {}, and no `{wanted}`", names.join(", "));
        let advice = "write one of these names as `serial` under [match] of a copy of the profile, \
            or run the maker's setup again";
        return Finding::bad(name, found, advice).by_hand();
    }
    if !is_named {
        let found = format!("GTDD_HOME is not set; {shown} would fit");
        return Finding::advice(name, found, format!("export GTDD_HOME={}", folder.display()));
    }
    Finding::good(name, format!("{shown}: {}", names.join(", ")))
}

/// Whether the arm is at the port that its configuration names: the number changes with the socket.
/// Newer arms have a HID node, and no port.
fn touch_port(
    machine: &SystemView<'_>,
    folder: Option<&Path>,
    serial: Option<&str>,
    nodes: &[DeviceFile],
) -> Option<Finding> {
    let file = folder?.join("config").join(format!("{}.config", serial.unwrap_or(TOUCH_NAME)));
    let text = machine.root.read(&file)?;
    let channel = text
        .lines()
        .find_map(|line| line.trim().strip_prefix("Channel=")?.trim().parse::<u32>().ok())?;
    let ports: Vec<String> = nodes
        .iter()
        .filter(|node| node.kind == NodeKind::Serial)
        .map(|node| node.path.display().to_string())
        .collect();
    let wanted = format!("/dev/ttyACM{channel}");
    let name = "port number";
    if ports.is_empty() {
        return None;
    }
    Some(if ports.contains(&wanted) {
        Finding::good(name, format!("{wanted}, as its configuration says"))
    } else {
        let found = format!(
            "the configuration says {wanted} (Channel={channel}), and the arm is at {}",
            ports.join(", ")
        );
        Finding::bad(
            name,
            found,
            format!("put the plug into the socket of before, or {TOUCH_SETUP}"),
        )
        .by_hand()
    })
}

/// Whether another program has the arm. One that was killed leaves it locked, which only its
/// opening shows.
fn touch_lock(machine: &SystemView<'_>, nodes: &[DeviceFile]) -> Finding {
    let mut found: Vec<Holder> =
        nodes.iter().flat_map(|node| holders(machine.root, &node.path)).collect();
    found.extend(with_library(
        machine.root,
        &["/libHD.so", "/libPhantomIOLib42.so", "/libPHANToMIO.so"],
    ));
    found.sort_by_key(|holder| holder.pid);
    found.dedup();
    if found.is_empty() {
        let unplug = "if it is: unplug the arm, wait ten seconds, and plug it in again".to_owned();
        let found = "no program that this user sees uses the library; whether a killed one has \
            left the arm locked shows when it is opened (HD error 0x0303)";
        return Finding { advice: unplug, by_hand: true, ..Finding::unknown("lock", found) };
    }
    let names: Vec<String> =
        found.iter().map(|holder| format!("{} (process {})", holder.name, holder.pid)).collect();
    let advice = "end it with Ctrl-C or as it wants to be ended: a program that is killed leaves \
        the arm locked until it is unplugged";
    Finding::bad(
        "lock",
        format!("the arm or its library is in use by {}", names.join(", ")),
        advice,
    )
    .by_hand()
}

/// Processes that have a library in their memory, as far as this user may see.
fn with_library(root: &Root, files: &[&str]) -> Vec<Holder> {
    let own = std::process::id();
    let pids = root.names("/proc").into_iter().filter_map(|name| name.parse::<u32>().ok());
    let has = |pid: &u32| {
        root.read(format!("/proc/{pid}/maps"))
            .is_some_and(|maps| files.iter().any(|file| maps.contains(file)))
    };
    let name = |pid: u32| root.read(format!("/proc/{pid}/comm")).unwrap_or_else(|| "?".to_owned());
    pids.filter(|pid| *pid != own).filter(has).map(|pid| Holder { pid, name: name(pid) }).collect()
}

/// Whether something listens where the service of Haption does, for an arm whose address is that of
/// this machine.
fn virtuose_service(machine: &SystemView<'_>, address: Option<&str>) -> Option<Finding> {
    let (host, port) = address.map_or(Some(("127.0.0.1", VIRTUOSE_PORT)), |address| {
        let (host, port) = address.split_once('#')?;
        Some((host, port.parse().ok()?))
    })?;
    if !["127.0.0.1", "localhost"].contains(&host) {
        return None;
    }
    let at = format!(":{port:04X} ");
    let mut tables = ["tcp", "tcp6", "udp", "udp6"]
        .into_iter()
        .filter_map(|name| machine.root.read(format!("/proc/net/{name}")));
    // The second word of a line is the local address.
    let is_there = tables.any(|table| {
        table
            .lines()
            .filter_map(|line| line.split_whitespace().nth(1))
            .any(|local| format!("{local} ").ends_with(&at))
    });
    Some(if is_there {
        Finding::good("maker's service", format!("something listens at {host}#{port}"))
    } else {
        let advice = "start the maker's service; where the controller has an address of its own, \
            write it as `serial` under [match] of a copy of the profile";
        Finding::advice("maker's service", format!("nothing listens at {host}#{port}"), advice)
            .by_hand()
    })
}

/// The services that shipped profiles look for and that run. Cold; opens a connection to each, and
/// closes it.
pub fn services() -> Vec<RunningService> {
    let profiles = profile::names().filter_map(|name| profile::find(name, Path::new("")).ok());
    let mut addresses: Vec<String> = profiles
        .filter_map(|profile| match profile.real?.protocol {
            Protocol::HaplyService(service) => Some(service.address),
            _ => None,
        })
        .collect();
    addresses.dedup();
    addresses.iter().filter_map(|address| running_service(address)).collect()
}

/// Whether the service of an arm runs, in a version that is spoken, and knows the arm and its grip.
fn service_finding(wanted: &HaplyService) -> Finding {
    let name = "maker's service";
    let address = &wanted.address;
    let Some(RunningService { version, arms, grips, .. }) = running_service(address) else {
        let advice = "sudo systemctl start haply-inverse-service   # or write its `address` under \
            [protocol] of a copy of the profile";
        return Finding::bad(name, format!("no Inverse service answers at {address}"), advice);
    };
    let found = format!(
        "Inverse service {version} at {address}, {} arms, {} grips",
        arms.len(),
        grips.len()
    );
    if let Err(StartError::Refused(why)) = Dialect::of(wanted.version.unwrap_or(version)) {
        return Finding::bad(name, found, why).by_hand();
    }
    match (arms.is_empty(), grips.is_empty() && wanted.has_grip) {
        (true, _) => Finding::bad(name, found, "plug the arm in and switch it on").by_hand(),
        (_, true) => {
            Finding::bad(name, found, "switch the grip on, or take the profile inverse3-no-grip")
                .by_hand()
        }
        _ => Finding::good(name, found),
    }
}

#[cfg(test)]
mod tests;
