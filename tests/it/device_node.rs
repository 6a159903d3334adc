//! The command beside the arm; what its node does packet by packet is tested in
//! `crates/arms/src/remote/node/tests.rs`.

#[cfg(not(feature = "zenoh"))]
#[test]
fn a_program_without_a_network_says_how_to_build_one() {
    let scene = super::rig::shipped("block-on-plane");
    for line in [
        "device-node sim-sigma7".to_owned(),
        format!("run {} --device zenoh:left", scene.display()),
    ] {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_hapticd"));
        let ended = command.args(line.split_whitespace()).output().expect("starts");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert!(
            ended.status.code() == Some(2) && said.contains("--features zenoh"),
            "{line}: {said}"
        );
    }
}
