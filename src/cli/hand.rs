//! The hand that holds a simulated arm without a scene in the same process.

use core::time::Duration;
use std::path::PathBuf;

use super::OutputOptions;
use super::cache::CacheArgs;
use super::error::CliError;
use super::memory::MemoryRule;
use crate::config::{self, SceneConfig};
use crate::scene;
use crate::scene::cache::CachePolicy;
use arms::simulated::HandParameters;
use arms::simulated::hand::{HandMapping, HandPath};
use rt::duration;
use vps::spatial::Pose;

/// The hand on the grip.
#[derive(Debug, clap::Args)]
pub(crate) struct HandArgs {
    /// Where the hand wants to be: CSV with the header t_s,x_m,y_m,z_m,qx,qy,qz,qw (or
    /// x_mm,y_mm,z_mm); it counts from the first pose, or as in SCENE.
    #[arg(long, value_name = "FILE.csv", conflicts_with = "no_hand")]
    hand: Option<PathBuf>,
    /// No hand holds the grip.
    #[arg(long)]
    no_hand: bool,
    /// Take the hand's file, strength and frame from this scene: the tool moves as it does with a
    /// simulated arm in the process.
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// How long the hand waits at its start after the host's first frame: until the host has
    /// enabled the arm.
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = duration::parse)]
    hand_delay: Duration,
    #[command(flatten)]
    cache: CacheArgs,
}

impl HandArgs {
    /// How long it waits where its path begins.
    pub(crate) fn delay(&self) -> Duration {
        self.hand_delay
    }

    /// The hand that the arguments ask for.
    pub(crate) fn hand(&self, output: OutputOptions) -> Result<Option<HandParameters>, CliError> {
        let config = self.scene.as_deref().map(config::load).transpose()?;
        let is_held = config.as_ref().is_none_or(|config| config.device.sim.hand_present);
        if self.no_hand || !is_held {
            return Ok(None);
        }
        let file = self
            .hand
            .clone()
            .or_else(|| config.as_ref().and_then(|config| config.device.hand.clone()));
        let path = file.as_deref().map(HandPath::read).transpose();
        let path = path.map_err(CliError::configuration)?;
        let mut hand = HandParameters::default();
        if let Some(SceneConfig { device, .. }) = &config {
            hand.stiffness_n_per_m = device.sim.hand_stiffness_n_per_m;
            hand.damping_n_s_per_m = device.sim.hand_damping_n_s_per_m;
            hand.mass_kg = device.sim.hand_mass_kg;
        }
        let Some(path) = path else { return Ok(Some(hand)) };
        let indexing = match &config {
            Some(config) => self.indexing_of(config, output)?,
            None => HandMapping {
                world_from_device: Pose::IDENTITY,
                scale: 1.0,
                start: path.sample(0.0),
                grip_tool: glam::DVec3::ZERO,
            },
        };
        hand.path = Some(path.to_device(indexing));
        Ok(Some(hand))
    }

    /// How the grip follows the tool of a scene; the tool's centre of mass takes a bake, or the
    /// cache.
    fn indexing_of(
        &self,
        config: &SceneConfig,
        output: OutputOptions,
    ) -> Result<HandMapping, CliError> {
        let memory = MemoryRule::Unlimited;
        let baked = self.cache.bake(CachePolicy::Mapped, memory, output, |options, progress| {
            scene::build_with(config, options, |event| progress.tell(&event))
        });
        let (scene, _) = baked?;
        let port = &config.parameters.mapping;
        Ok(HandMapping {
            world_from_device: port.world_from_device,
            scale: port.scale,
            start: port.start,
            grip_tool: scene.tool.center_of_mass_tool,
        })
    }
}
