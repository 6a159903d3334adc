//! A whole haptic loop at 1 kHz on an arm of your own: `cargo run -p haptics --example
//! custom_device`.
#![expect(clippy::print_stdout, reason = "what an example is for")]

use arms::{Capabilities, Device, DeviceError};
use haptics::{
    DriveRequest, LimitParameters, Parameters, SceneBuilder, State, TickInput, ToolOptions, tick,
};
use rt::clock::{Clock, RealClock};
use vps::spatial::{Axes, DeviceSample, SampleStatus, Twist, Wrench};
use vps::{DVec3, Options, Pose, Shape, part::Part};

/// Your arm. This one is 100 g on a vertical slide, a little oil in it, that a hand presses down
/// with 1 N.
#[derive(Default)]
struct MyArm {
    height_m: f64,
    speed_m_per_s: f64,
    force_n: f64,
    sequence: u64,
}

impl Device for MyArm {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            sensed: Axes::SIX,
            actuated: Axes::TRANSLATION,
            simulated: true,
            ..Capabilities::default()
        }
    }
    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.speed_m_per_s += (self.force_n - 1.0 - 5.0 * self.speed_m_per_s) / 0.1 * 1e-3;
        self.height_m += self.speed_m_per_s * 1e-3;
        self.sequence += 1;
        let pose = Pose::from_translation(DVec3::Z * self.height_m);
        let linear = DVec3::Z * self.speed_m_per_s;
        let twist = Twist { linear, angular: DVec3::ZERO };
        Ok(DeviceSample {
            pose,
            twist,
            sequence: self.sequence,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        })
    }
    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.force_n = wrench_device.force.z;
        Ok(Wrench::new(DVec3::Z * self.force_n, DVec3::ZERO))
    }
    fn stop(&mut self) {
        self.force_n = 0.0;
    }
}

/// A ball on the grip, a block 5 mm below it, two seconds. Returns the height of the grip, m, and
/// the force of the motors, N.
pub(crate) fn run(mut clock: impl Clock) -> Result<(f64, f64), Box<dyn std::error::Error>> {
    let limits = LimitParameters { force_n: 4.0, slew_n_per_s: 500.0, ..LimitParameters::NONE };
    let mut builder = SceneBuilder::new(Parameters { limits, ..Parameters::unlimited(1e-3) });
    let block = Part::of_shape("block", &Shape::Box { size_m: DVec3::splat(40e-3) }, 1e-3);
    builder.add_part(&block, &Options::new(1e-3), Pose::from_translation(DVec3::Z * -35e-3))?;
    let ball = Part::of_shape("ball", &Shape::Sphere { radius_m: 10e-3 }, 1e-3);
    let (scene, _reports) = builder.finish(&ball, &Options::new(1e-3), &ToolOptions::new(0.1))?;
    let mut state = State::new(&scene);
    let mut arm = MyArm::default();
    let mut made = Wrench::ZERO;
    let start_ns = clock.now_ns();
    for tick_number in 1..=2000 {
        clock.sleep_until(start_ns + tick_number * 1_000_000);
        let Ok(sample) = arm.read() else { break };
        let output = tick(
            &scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        made = arm.write(&output.command_device).unwrap_or_default();
    }
    arm.stop();
    Ok((arm.height_m, made.force.z))
}

#[cfg_attr(test, expect(dead_code, reason = "a test runs it under another clock"))]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (height_m, force_n) = run(RealClock)?;
    println!(
        "the arm rests at {:.2} mm, and its motors hold {force_n:.2} N against the hand",
        height_m * 1e3
    );
    Ok(())
}
