//! What is opened, and what is known again.

use super::*;

fn board(path: &str, serial: &str) -> DeviceFile {
    DeviceFile {
        vendor_id: 0x16c0,
        product_id: 0x0483,
        serial: serial.to_owned(),
        ..DeviceFile::at(Path::new(path))
    }
}

#[test]
fn a_board_that_comes_back_under_another_name_is_known_by_what_it_is() {
    let first = board("/dev/ttyACM0", "77");
    let find = |attached: &[DeviceFile]| {
        again(&first, Path::new("/dev/ttyACM0"), attached).map(|node| node.path)
    };
    assert_eq!(find(&[]), None);
    assert_eq!(find(std::slice::from_ref(&first)), Some("/dev/ttyACM0".into()));
    assert_eq!(find(&[board("/dev/ttyACM1", "77")]), Some("/dev/ttyACM1".into()));
    // Another device has its name now.
    assert_eq!(find(&[board("/dev/ttyACM0", "78")]), None);
    assert_eq!(
        find(&[board("/dev/ttyACM0", "78"), board("/dev/ttyACM1", "77")]),
        Some("/dev/ttyACM1".into())
    );
    assert_eq!(find(&[DeviceFile { product_id: 0x0486, ..first.clone() }]), None);
}

#[test]
fn of_several_ports_of_one_device_the_one_of_the_same_name_is_taken() {
    let port =
        |path: &str, name: &str| DeviceFile { by_id: Some(name.into()), ..board(path, "77") };
    let first = port("/dev/ttyUSB0", "FT_77-port0");
    let moved = [port("/dev/ttyUSB4", "FT_77-port0"), port("/dev/ttyUSB5", "FT_77-port1")];
    let find = |first: &DeviceFile, attached: &[DeviceFile]| {
        again(first, Path::new("/dev/ttyUSB0"), attached).map(|node| node.path)
    };
    assert_eq!(find(&first, &moved), Some("/dev/ttyUSB4".into()));
    let swapped = [port("/dev/ttyUSB0", "FT_77-port1"), port("/dev/ttyUSB1", "FT_77-port0")];
    assert_eq!(
        find(&first, &swapped),
        Some("/dev/ttyUSB1".into()),
        "its path belongs to the other port now"
    );
    assert_eq!(
        find(&DeviceFile { by_id: None, ..first.clone() }, &moved),
        None,
        "which of the two?"
    );
    // A pseudo-terminal says nothing of itself: its path is all there is.
    assert_eq!(find(&DeviceFile::at(Path::new("/dev/pts/4")), &moved), Some("/dev/ttyUSB0".into()));
}

#[test]
fn a_port_that_is_held_names_its_holder() {
    let (far, near) = serialport::TTYPort::pair().expect("a pty");
    let path = PathBuf::from(serialport::SerialPort::name(&near).expect("has one"));
    let file = std::fs::File::open(&path).expect("a tty");
    drop(near);
    // A program of its own with the node open, which keeps the lock that it inherits.
    let lock = SerialLink::open(&path, 115_200).expect("free");
    let mut other = std::process::Command::new("sleep")
        .arg("60")
        .stdin(std::process::Stdio::from(file))
        .spawn()
        .expect("a program");
    let busy = SerialLink::open(&path, 115_200).map(|_| ()).expect_err("held");
    let text = held(&path, busy.into()).to_string();
    let pid = other.id();
    other.kill().and_then(|()| other.wait()).expect("ours");
    assert!(
        text.contains(&format!("sleep (process {pid})")) && text.contains(&*path.to_string_lossy()),
        "{text}"
    );
    // No other process: the words of the port.
    let busy = SerialLink::open(&path, 115_200).map(|_| ()).expect_err("held by ourselves");
    assert!(held(&path, busy.into()).to_string().contains("cannot open"));
    drop((lock, far));
}

/// Why an arm is not opened or looked for with this selector, and without a program for a worker.
fn refused(profile: &str, selector: Option<&str>) -> OpenError {
    let profile = crate::profile::find(profile, Path::new("")).expect("shipped");
    let selector = selector.map(|text| text.parse().expect("a selector"));
    let options = OpenOptions { selector, io_request: None, period_s: 1e-3, guard: None };
    let looked = look_for(&profile, &options).err();
    looked.unwrap_or_else(|| open(&profile, &options).err().expect("refused"))
}

#[test]
fn a_selector_that_means_another_arm_is_refused_and_never_passed_over() {
    for (profile, selector, words) in [
        ("omega7", "16c0:0483", "the USB vendor of its maker is 1451"),
        ("touch", "1451:0402:7", "the name that the maker's setup gave the arm"),
        ("virtuose-6d", "1451:0402", "`serial` under [match]"),
        ("omega7", "/dev/ttyACM0", "a path names the library of its maker"),
        ("inverse3", "1451:0402", "`address`, `arm` and `grip` under [protocol]"),
        ("inverse3-no-grip", "/dev/ttyACM0", "`address`, `arm` and `grip` under [protocol]"),
    ] {
        let error = refused(profile, Some(selector));
        assert!(
            matches!(error, OpenError::Selector { .. }) && error.to_string().contains(words),
            "{profile} {selector}: {error}"
        );
    }
}

#[test]
fn the_numbers_and_the_serial_number_of_a_maker_reach_its_library() {
    let profile = crate::profile::find("omega7", Path::new("")).expect("shipped");
    let real = profile.real.as_ref().expect("of metal");
    let Protocol::Vendor(protocol) = &real.protocol else { panic!("a library") };
    let chosen = |selector: &str| {
        let selector = Some(selector.parse().expect("a selector"));
        let options = OpenOptions { selector, io_request: None, period_s: 1e-3, guard: None };
        Connector::new(&profile, real, &options)
            .chosen(protocol)
            .map(|(protocol, serial)| (protocol.library, serial))
            .expect("of it")
    };
    assert_eq!(chosen("1451:0402:7"), (None, Some("7".to_owned())));
    assert_eq!(chosen("0403:cb48"), (None, None));
    assert_eq!(chosen("/opt/libdrd.so.3"), (Some("/opt/libdrd.so.3".into()), None));
}

#[test]
fn a_program_that_is_no_hapticd_has_to_name_one_for_the_library_of_a_maker() {
    // Any file that could be loaded, such as this program: whether it is the library shows in the
    // worker.
    let here = std::env::current_exe().expect("a program");
    let error = refused("omega7", here.to_str());
    assert!(error.to_string().contains("OpenOptions::guard names none"), "{error}");
    let text = refused("omega7", Some(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml")));
    assert!(text.to_string().contains("Cargo.toml is no library"), "{text}");
    let missing = refused("omega7", Some("./no/libdrd.so.3"));
    assert!(
        missing.to_string().contains("/no/libdrd.so.3")
            && missing.to_string().contains("there is no /"),
        "{missing}"
    );
    assert!(
        missing.hint().is_some_and(|hint| hint.contains("install the Force Dimension SDK")),
        "{missing}"
    );
}
