//! `hapticd devices`: which arms are attached, and what stands in their way.

use std::path::Path;

use clap::Subcommand;
use serde_json::{Value, json};

use super::error::{CliError, Outcome};
use super::findings::finding_json;
use super::{OutputOptions, output, probe, report};
use crate::error::Exit;
use arms::attached::discover::{self, AttachedNode};
use arms::attached::libraries::{self, MakersLibrary, SystemView};
use arms::attached::nodes;
use arms::profile::{self, Profile, ProfileError};
use arms::transport::RunningService;
use rt::finding::{Finding, Root, Standing};
use vps::storage::printable::one_line;

/// Arguments of `hapticd devices`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Option<DevicesCommand>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum DevicesCommand {
    /// List hidraw nodes, serial ports and services of arms, with the profiles that they fit.
    List {
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Open an arm and try it out: listens for 10 s with zero commands.
    Probe(probe::Args),
    /// List the profiles in the program; of a named one, print the file, to be copied and changed.
    Profiles {
        /// Profile to print, as TOML.
        name: Option<String>,
    },
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    match &args.command {
        Some(DevicesCommand::Probe(args)) => return probe::main(args, output),
        Some(DevicesCommand::Profiles { name }) => {
            return profiles(name.as_deref(), args.json);
        }
        Some(DevicesCommand::List { .. }) | None => {}
    }
    let as_json = args.json || matches!(args.command, Some(DevicesCommand::List { json: true }));
    let root = Root::default();
    let attached =
        discover::attached(nodes::list(), &discover::known_arms(), &root, discover::may_use);
    let machine = SystemView {
        root: &root,
        variable: &|name| std::env::var_os(name),
        may_use: &discover::may_use,
    };
    let (libraries, services) = (libraries::makers_libraries(&machine), libraries::services());
    if as_json {
        let nodes: Vec<Value> = attached.iter().map(|found| node_json(found, &root)).collect();
        let libraries: Vec<Value> = libraries.iter().map(library_json).collect();
        let services: Vec<Value> = services.iter().map(service_json).collect();
        output::result(format_args!(
            "{}\n",
            json!({ "nodes": nodes, "libraries": libraries, "services": services })
        ));
        return Ok(Exit::Ok);
    }
    for found in &libraries {
        output::result(format_args!("{}\n", one_line(&library_line(found))));
    }
    if attached.is_empty() && libraries.is_empty() && services.is_empty() {
        report::note(
            "no hidraw node and no serial port: is the arm plugged in and switched on? `hapticd \
                doctor` looks further",
            output,
        );
        return Ok(Exit::Ok);
    }
    for found in &attached {
        // What devices call themselves.
        output::result(format_args!("{}\n", one_line(&node_line(found))));
        for finding in troubles(found, &root) {
            output::result(format_args!("    {}: {}\n", finding.name, finding.found));
            for line in finding.advice_lines() {
                output::result(format_args!("        {line}\n"));
            }
        }
    }
    for service in &services {
        output::result(format_args!("{}\n", one_line(&service_line(service))));
    }
    Ok(Exit::Ok)
}

/// What is known of each built-in profile, or one of them as it is written.
fn profiles(name: Option<&str>, as_json: bool) -> Outcome {
    let here = Path::new("");
    let names: Vec<&str> = name.map_or_else(|| profile::names().collect(), |name| vec![name]);
    let find = |name: &str| {
        profile::find(name, here).map_err(|error| match error {
            ProfileError::Invalid(errors) => errors.into(),
            error => CliError::configuration(format_args!("{name}: {error}")),
        })
    };
    let found: Vec<Profile> = names.into_iter().map(find).collect::<Result<_, _>>()?;
    let text = name.and_then(|name| profile::text(name, here));
    match (text, as_json) {
        (Some(text), false) => output::result(format_args!("{text}")),
        (_, true) => {
            let rows: Vec<Value> = found.iter().map(profile_json).collect();
            output::result(format_args!("{}\n", json!({ "profiles": rows })));
        }
        (None, false) => {
            for Profile { name, title, .. } in &found {
                output::result(format_args!("{name:<28} {title}\n"));
            }
        }
    }
    Ok(Exit::Ok)
}

fn library_json(found: &MakersLibrary) -> Value {
    json!({
        "codec": found.family.name(),
        "path": found.path.as_ref().map(|path| path.display().to_string()),
        "plugged": found.plugged,
        "profiles": found.profiles,
    })
}

/// A library that opens arms by itself: which of them are there shows when it does.
fn library_line(found: &MakersLibrary) -> String {
    let path = found
        .path
        .as_ref()
        .map_or_else(|| "no library".to_owned(), |path| path.display().to_string());
    let plugged = if found.plugged.is_empty() {
        String::new()
    } else {
        format!("  plugged in: {}", found.plugged.join(", "))
    };
    let advice =
        if found.path.is_some() { "" } else { "  `hapticd doctor` says where it was looked for" };
    format!(
        "{path}  {}{plugged}  profiles {}{advice}",
        found.family.name(),
        found.profiles.join(", ")
    )
}

fn profile_json(profile: &Profile) -> Value {
    json!({ "name": profile.name, "title": profile.title, "simulated": profile.real.is_none() })
}

/// Problems of arms only; the program does not judge other nodes.
fn troubles(found: &AttachedNode, root: &Root) -> Vec<Finding> {
    if found.profiles.is_empty() && found.beside.is_empty() {
        return Vec::new();
    }
    discover::findings(found, root)
        .into_iter()
        .filter(|finding| finding.standing >= Standing::Advice)
        .collect()
}

fn node_line(found: &AttachedNode) -> String {
    let node = &found.node;
    let mut words = vec![format!("{:<16} {:<6}", node.path.display(), node.kind.name())];
    if node.vendor_id != 0 {
        words.push(format!("{:04x}:{:04x}", node.vendor_id, node.product_id));
    }
    words.extend(node.interface.map(|interface| format!("interface {interface}")));
    words.extend(node.usages.first().map(|(page, usage)| format!("usage {page:04x}:{usage:04x}")));
    words.extend(
        [&node.product, &node.serial]
            .into_iter()
            .filter(|text| !text.is_empty())
            .map(|text| format!("\"{text}\"")),
    );
    words.extend(node.by_id.as_ref().map(|name| name.display().to_string()));
    words.push(match (found.profiles.as_slice(), found.beside.as_slice()) {
        ([], []) => "no profile".to_owned(),
        ([], beside) => format!("beside {}", beside.join(", ")),
        (profiles, _) => format!("profile {}", profiles.join(", ")),
    });
    if !found.permitted {
        words.push("no permission".to_owned());
    }
    words.extend(
        found.holders.iter().map(|holder| format!("held by {} ({})", holder.name, holder.pid)),
    );
    words.join("  ")
}

fn service_line(service: &RunningService) -> String {
    let RunningService { address, version, arms, grips } = service;
    let mut words = vec![format!("{address:<16} service  Inverse service {version}")];
    words.extend(arms.iter().map(|(kind, id)| format!("{kind} {id}")));
    words.extend(grips.iter().map(|id| format!("grip {id}")));
    words.push(match (arms.is_empty(), grips.is_empty()) {
        (true, _) => "no arm: plug it in and switch it on".to_owned(),
        (false, true) => "profile inverse3-no-grip".to_owned(),
        (false, false) => "profile inverse3".to_owned(),
    });
    words.join("  ")
}

fn service_json(service: &RunningService) -> Value {
    let RunningService { address, version, arms, grips } = service;
    let arms: Vec<Value> =
        arms.iter().map(|(kind, id)| json!({ "type": kind, "id": id })).collect();
    json!({ "address": address, "version": version.to_string(), "arms": arms, "grips": grips })
}

pub(super) fn node_json(found: &AttachedNode, root: &Root) -> Value {
    let node = &found.node;
    json!({
        "path": node.path,
        "kind": node.kind.name(),
        "by_id": node.by_id,
        "vendor_id": node.vendor_id,
        "product_id": node.product_id,
        "serial": node.serial,
        "product": node.product,
        "interface": node.interface,
        "usages": node.usages.iter().map(|(page, usage)| json!({ "page": page, "usage": usage })).collect::<Vec<_>>(),
        "permitted": found.permitted,
        "holders": found.holders.iter().map(|holder| json!({ "pid": holder.pid, "name": holder.name })).collect::<Vec<_>>(),
        "profiles": found.profiles,
        "beside": found.beside,
        "findings": troubles(found, root).iter().map(finding_json).collect::<Vec<_>>(),
    })
}
