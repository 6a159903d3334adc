//! Each trap on a machine that is made up: its files, and its environment.

use std::os::unix::fs::symlink;

use super::*;
use rt::finding::{Standing, tree};

/// Where a library says for which processor it is.
const PROCESSOR: usize = 18;

/// The first bytes of a library, and the names of those that it needs.
fn library(needs: &[&str]) -> String {
    let mut text = "\u{7f}ELF\u{2}\u{1}\u{1}\0\0\0\0\0\0\0\0\0\u{3}\0\0\0".to_owned();
    text.extend(needs.iter().flat_map(|need| [*need, "\0"]));
    text
}

/// A root with these files, libraries for this processor among them.
fn machine(files: &[(&str, &str)]) -> (tempfile::TempDir, Root) {
    let (folder, root) = tree(files);
    let own = if cfg!(target_arch = "aarch64") { 183 } else { 62 };
    for (path, text) in
        files.iter().filter(|(_, text)| text.starts_with("\u{7f}ELF") && text.len() > PROCESSOR)
    {
        let mut bytes = text.as_bytes().to_vec();
        bytes[PROCESSOR] = own;
        fs::write(root.join(path), bytes).expect("written");
    }
    (folder, root)
}

/// Findings of a family on a machine with these files and this environment.
fn reported(
    family: Family,
    files: &[(&str, &str)],
    variables: &[(&str, &str)],
    may_use: bool,
) -> Vec<Finding> {
    let (_folder, root) = machine(files);
    for (path, _) in files.iter().filter(|(path, _)| path.starts_with("/sys/devices/")) {
        // A node of a class leads to its device.
        let name = Path::new(path).file_name().expect("named").to_string_lossy().into_owned();
        if let Some(class) = name
            .strip_prefix("ttyACM")
            .map(|_| "tty")
            .or(name.strip_prefix("hidraw").map(|_| "hidraw"))
        {
            let node = root.join(format!("/sys/class/{class}/{name}"));
            fs::create_dir_all(&node).expect("folder");
            symlink(root.join(path).parent().expect("a device"), node.join("device"))
                .expect("link");
        }
    }
    let variable = |name: &str| {
        variables.iter().find(|(known, _)| *known == name).map(|(_, value)| OsString::from(*value))
    };
    findings(
        &SystemView { root: &root, variable: &variable, may_use: &|_| may_use },
        family,
        None,
        None,
    )
}

fn row<'f>(findings: &'f [Finding], name: &str) -> &'f Finding {
    findings
        .iter()
        .find(|finding| finding.name == name)
        .unwrap_or_else(|| panic!("{name}: {findings:#?}"))
}

/// A Touch that is set up and plugged in, at the port that its configuration says.
fn touch<'f>(lib: &'f str, config: &'f str) -> Vec<(&'f str, &'f str)> {
    vec![
        ("/usr/lib/libHD.so.3.4", lib),
        ("/usr/lib/libPhantomIOLib42.so", "\u{7f}ELF"),
        ("/home/a/.3dsystems/config/Default Device.config", config),
        ("/sys/devices/usb1/1-2/idVendor", "2988\n"),
        ("/sys/devices/usb1/1-2/idProduct", "0302\n"),
        ("/sys/devices/usb1/1-2/1-2:1.0/ttyACM0", ""),
    ]
}

const HOME: [(&str, &str); 2] = [("HOME", "/home/a"), ("GTDD_HOME", "/home/a/.3dsystems")];

#[test]
fn a_touch_that_is_set_up_has_nothing_in_its_way() {
    let lib = library(&["libPhantomIOLib42.so"]);
    let findings =
        reported(Family::OpenHaptics, &touch(&lib, "ModelType=OMNI\nChannel=0\n"), &HOME, true);
    assert!(findings.iter().all(|finding| finding.standing <= Standing::Unknown), "{findings:#?}");
    assert_eq!(
        row(&findings, "configuration folder").found,
        "/home/a/.3dsystems/config: Default Device"
    );
    assert!(row(&findings, "port number").found.starts_with("/dev/ttyACM0"));
    let lock = row(&findings, "lock");
    assert!(lock.found.contains("0x0303") && lock.advice.contains("unplug"), "{lock:?}");
}

#[test]
fn what_the_library_of_3d_systems_needs_is_named_when_it_is_not_there() {
    let lib = library(&["libPhantomIOLib42.so", "libncurses.so.5"]);
    let all = touch(&lib, "Channel=0");
    let ncurses = reported(Family::OpenHaptics, &all, &HOME, true);
    assert!(
        row(&ncurses, "ncurses 5").found.contains("libncurses.so.5")
            && row(&ncurses, "ncurses 5").advice.contains("apt install")
    );
    let without = |part: &str| {
        all.iter().filter(|(path, _)| !path.contains(part)).copied().collect::<Vec<_>>()
    };
    let driver = reported(Family::OpenHaptics, &without("Phantom"), &HOME, true);
    assert!(row(&driver, "driver of the arm").advice.contains("TouchDriver"));
    // What the driver itself needs counts as well.
    let older = library(&["libPHANToMIO.so.4"]);
    let files = [
        ("/usr/lib/libHD.so.3.0", older.as_str()),
        ("/opt/oh/libPHANToMIO.so.4", &lib),
        ("/etc/ld.so.conf.d/oh.conf", "/opt/oh\n"),
    ];
    let chained = reported(Family::OpenHaptics, &files, &HOME, true);
    assert!(
        row(&chained, "ncurses 5").standing == Standing::Bad
            && row(&chained, "driver of the arm").found.contains("libPhantomIOLib42.so")
    );
}

#[test]
fn the_configuration_of_a_touch_is_looked_for_where_its_library_does() {
    let lib = library(&[]);
    let all = touch(&lib, "Channel=0");
    let configuration = |files: &[(&str, &str)], variables: &[(&str, &str)]| {
        row(&reported(Family::OpenHaptics, files, variables, true), "configuration folder").clone()
    };
    let unset = configuration(&all, &HOME[..1]);
    assert_eq!(
        (unset.standing, unset.advice.as_str()),
        (Standing::Advice, "export GTDD_HOME=/home/a/.3dsystems")
    );
    let empty = configuration(&all, &[("HOME", "/home/a"), ("GTDD_HOME", "")]);
    assert_eq!(empty, unset, "an empty variable is none");
    let elsewhere = configuration(&all, &[("HOME", "/home/a"), ("GTDD_HOME", "/opt/geomagic")]);
    assert!(
        elsewhere.standing == Standing::Bad
            && elsewhere.found.contains("/opt/geomagic/config holds no configuration"),
        "{elsewhere:?}"
    );
    let none = configuration(&all[..1], &[("HOME", "/root"), ("SUDO_USER", "a")]);
    assert!(
        none.standing == Standing::Bad
            && none.found.contains("sudo takes GTDD_HOME away")
            && none.advice.contains("without sudo"),
        "{none:?}"
    );
    let named =
        [("/usr/lib/libHD.so", lib.as_str()), ("/usr/share/3DSystems/config/right.config", "")];
    let other = configuration(&named, &[]);
    assert!(
        other.found.contains("knows right, and no `Default Device`")
            && other.advice.contains("`serial`"),
        "{other:?}"
    );
}

#[test]
fn a_touch_in_another_socket_has_another_port() {
    let lib = library(&[]);
    let port = |config| {
        row(&reported(Family::OpenHaptics, &touch(&lib, config), &HOME, true), "port number")
            .clone()
    };
    let moved = port("ModelType=OMNI\nChannel=2\n");
    assert_eq!(moved.standing, Standing::Bad);
    assert!(
        moved.found.contains("/dev/ttyACM2 (Channel=2), and the arm is at /dev/ttyACM0")
            && moved.advice.contains("socket"),
        "{moved:?}"
    );
    // A newer one has a HID node, and no number.
    let mut hid = touch(&lib, "Channel=2");
    hid.retain(|(path, _)| !path.contains("ttyACM"));
    hid.push(("/sys/devices/usb1/1-2/1-2:1.0/hidraw3", ""));
    let findings = reported(Family::OpenHaptics, &hid, &HOME, false);
    assert!(findings.iter().all(|finding| finding.name != "port number"), "{findings:?}");
    assert!(row(&findings, "permission").found.contains("/dev/hidraw3 may not be opened"));
}

#[test]
fn a_program_that_has_a_touch_is_named_and_not_to_be_killed() {
    let lib = library(&[]);
    let mut files = touch(&lib, "Channel=0");
    files.extend([
        ("/proc/42/comm", "Touch_Diagnostic\n"),
        ("/proc/42/maps", "7f00-7f01 r-xp 0 08:01 1 /usr/lib/libHD.so.3.4.0\n"),
    ]);
    let lock = row(&reported(Family::OpenHaptics, &files, &HOME, true), "lock").clone();
    assert_eq!(lock.standing, Standing::Bad);
    assert!(
        lock.found.contains("Touch_Diagnostic (process 42)")
            && lock.advice.contains("locked until it is unplugged"),
        "{lock:?}"
    );
    assert!(!lock.advice.contains("kill 42"));
}

#[test]
fn force_dimensions_library_is_judged_by_its_name_and_by_what_it_needs() {
    let lib = library(&["libusb-1.0.so.0"]);
    let files = [
        ("/opt/sdk/lib/libdhd.so.3.14.0", lib.as_str()),
        ("/sys/bus/usb/devices/1-3/idVendor", "1451\n"),
        ("/sys/bus/usb/devices/1-3/idProduct", "0402\n"),
        ("/sys/bus/usb/devices/1-3/busnum", "1\n"),
        ("/sys/bus/usb/devices/1-3/devnum", "7\n"),
        ("/proc/9/comm", "HapticDesk\n"),
        ("/proc/9/fd/.keep", ""),
    ];
    let (_folder, root) = machine(&files);
    symlink("/dev/bus/usb/001/007", root.join("/proc/9/fd/4")).expect("link");
    let library_of = |name: &str| {
        (name == "HAPTICD_LIBDRD").then(|| OsString::from("/opt/sdk/lib/libdhd.so.3.14.0"))
    };
    let here = SystemView { root: &root, variable: &library_of, may_use: &|_| false };
    let findings = findings(&here, Family::ForceDimension, None, None);
    assert!(row(&findings, "libusb").advice.contains("libusb-1.0-0"));
    assert!(
        row(&findings, "homing").found.contains("--home")
            && row(&findings, "version").found.contains("3.14")
    );
    assert!(row(&findings, "permission").found.contains("/dev/bus/usb/001/007 may not be opened"));
    assert!(row(&findings, "holder").found.contains("HapticDesk (process 9)"));
    assert_eq!(makers_libraries(&here)[0].plugged, ["1451:0402"]);
}

#[test]
fn a_library_that_is_nowhere_or_none_is_a_finding_with_a_list() {
    let nowhere = reported(Family::ForceDimension, &[], &[("HOME", "/home/a")], true);
    let missing = row(&nowhere, "maker's library");
    assert!(
        missing.standing == Standing::Bad && missing.by_hand && missing.advice_lines().count() == 7,
        "{missing:?}"
    );
    let text = reported(Family::OpenHaptics, &[("/usr/lib/libHD.so", "# a script\n")], &[], true);
    assert!(
        row(&text, "maker's library").found.contains("/usr/lib/libHD.so is no library"),
        "{text:?}"
    );
}

#[test]
fn the_service_of_haption_is_looked_for_where_it_listens() {
    let lib = library(&[]);
    let with = |table: &str| {
        let files = [("/usr/lib/libVirtuoseAPI.so", lib.as_str()), ("/proc/net/udp", table)];
        row(&reported(Family::Virtuose, &files, &[], true), "maker's service").clone()
    };
    assert_eq!(
        with("  sl  local_address\n   1: 0100007F:CFDA 00000000:0000 07\n").standing,
        Standing::Good
    );
    let none = with("  sl  local_address\n   1: 0100007F:1234 0100007F:CFDA 07\n");
    assert!(
        none.standing == Standing::Advice && none.found.contains("127.0.0.1#53210"),
        "{none:?}"
    );
    assert_eq!(
        virtuose_service(
            &SystemView { root: &Root::default(), variable: &|_| None, may_use: &|_| true },
            Some("10.0.0.2#5000")
        ),
        None
    );
}

#[test]
fn a_service_that_does_not_run_is_a_finding_with_the_command_that_starts_it() {
    // A port that was free a moment ago.
    let address = std::net::TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("a port")
        .to_string();
    let finding = service_finding(&HaplyService {
        address,
        arm: None,
        grip: None,
        has_grip: true,
        version: None,
    });
    assert!(
        finding.standing == Standing::Bad
            && finding.advice.starts_with("sudo systemctl start haply"),
        "{finding:?}"
    );
}
