//! The client library of Haply's own against `hapticd mock inverse3 --service`: whether the mock
//! speaks as the service that the library was written for.
//!
//! `cargo run --manifest-path tests/haply-client/Cargo.toml -- target/release/hapticd`

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use haply::HaplyDevice;
use haply::device_model::{Config, Force, ForceInput, ServiceData};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// A mock that does not outlive this program.
struct Mock(Child);

impl Drop for Mock {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(program: &str) -> Result<(Mock, String), Failure> {
    let arguments =
        ["mock", "inverse3", "--service", "127.0.0.1:0", "--no-hand", "--duration", "60s"];
    let mut child = Command::new(program).args(arguments).stdout(Stdio::piped()).spawn()?;
    let stdout = child.stdout.take().ok_or("no output")?;
    let mock = Mock(child);
    let mut line = String::new();
    BufReader::new(stdout).read_line(&mut line)?;
    let address =
        line.strip_prefix("ready ").ok_or_else(|| format!("said {line:?}"))?.trim().to_owned();
    Ok((mock, address))
}

fn position(data: &ServiceData) -> Result<[f64; 3], Failure> {
    let position =
        data.inverse3.first().and_then(|arm| arm.state.cursor_position).ok_or("no position")?;
    Ok([position.x.into(), position.y.into(), position.z.into()])
}

fn check(is: bool, what: &str) -> Result<(), Failure> {
    println!("{} {what}", if is { "ok    " } else { "FAILED" });
    if is { Ok(()) } else { Err(what.into()) }
}

#[tokio::main]
async fn main() -> Result<(), Failure> {
    let program = std::env::args().nth(1).ok_or("give the path of a hapticd")?;
    let (_mock, address) = start(&program)?;
    let mut device =
        HaplyDevice::new(&format!("http://{address}"), &format!("ws://{address}/")).await?;
    let version = device.get_service_version().await?;
    check(version.project_version == "3.5.0", "the version over HTTP")?;

    let first = device.force_read_full_state(Some(Duration::from_secs(5))).await?;
    check(
        first.inverse3.len() == 1 && first.wireless_verse_grip.len() == 1,
        "the first message: one arm, one grip",
    )?;
    let configs = device.get_devices().await?;
    let has_arm = configs
        .iter()
        .any(|config| matches!(config, Config::DeviceConfig(arm) if arm.device_info.id == "049D"));
    check(configs.len() == 2 && has_arm, "the configuration of both")?;
    check(
        first.inverse3[0].status.calibrated && first.inverse3[0].status.ready,
        "the status of the arm",
    )?;
    let rest = position(&first)?;

    let push =
        |x| vec![ForceInput { device_id: "049D".to_owned(), forces: Force { x, y: 0.0, z: 0.0 } }];
    for _ in 0..100 {
        device.update_force(push(0.5), None, Some(true)).await?;
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    tokio::time::sleep(Duration::from_millis(20)).await;
    let pushed = device.read_state().await?;
    let felt = pushed.inverse3[0].state.current_cursor_force.ok_or("no force")?;
    check((f64::from(felt.x) - 0.5).abs() < 1e-6, "the force that was asked for")?;
    let moved = position(&pushed)?;
    check(moved[0] - rest[0] > 1e-3, "the arm moved along it")?;
    let across = (moved[1] - rest[1]).abs().max((moved[2] - rest[2]).abs());
    check(across < 0.1 * (moved[0] - rest[0]), "and not across")?;

    // Silence: the service lets go.
    tokio::time::sleep(Duration::from_millis(300)).await;
    device.send_ping().await?;
    tokio::time::sleep(Duration::from_millis(50)).await;
    let silent = device.read_state().await?;
    let felt = silent.inverse3[0].state.current_cursor_force.ok_or("no force")?;
    check(f64::from(felt.x) == 0.0, "no force after a silence")?;
    device.shutdown().await
}
