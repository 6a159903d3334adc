//! `hapticd devices`: which arms are attached, and what stands in their way.

use clap::Subcommand;
use serde_json::{Value, json};

use super::findings::finding_json;
use super::{Talk, probe, report, say};
use crate::device::attached::discover::{self, Attached};
use crate::device::attached::nodes;
use crate::error::Exit;
use crate::rt::finding::{Finding, Root, Standing};

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
    /// List hidraw nodes and serial ports, with the profiles that they fit.
    List {
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Open an arm and try it out: listens for 10 s with zero commands.
    Probe(probe::Args),
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    if let Some(DevicesCommand::Probe(args)) = &args.command {
        return probe::main(args, talk);
    }
    let as_json = args.json || matches!(args.command, Some(DevicesCommand::List { json: true }));
    let root = Root::default();
    let attached = discover::attached(nodes::list(), &discover::known_arms(), &root, discover::may_use);
    if as_json {
        let nodes: Vec<Value> = attached.iter().map(|found| node_json(found, &root)).collect();
        say::result(format_args!("{}\n", json!({ "nodes": nodes })));
        return Exit::Ok;
    }
    if attached.is_empty() {
        report::note(
            "no hidraw node and no serial port: is the arm plugged in and switched on? `hapticd doctor` looks further",
            talk,
        );
        return Exit::Ok;
    }
    for found in &attached {
        say::result(format_args!("{}\n", node_line(found)));
        for finding in troubles(found, &root) {
            say::result(format_args!("    {}: {}\n", finding.name, finding.found));
            for line in finding.advice_lines() {
                say::result(format_args!("        {line}\n"));
            }
        }
    }
    Exit::Ok
}

/// Troubles are told of arms only: what becomes of other nodes is nobody's concern here.
fn troubles(found: &Attached, root: &Root) -> Vec<Finding> {
    if found.profiles.is_empty() && found.beside.is_empty() {
        return Vec::new();
    }
    discover::findings(found, root).into_iter().filter(|finding| finding.standing >= Standing::Advice).collect()
}

fn node_line(found: &Attached) -> String {
    let node = &found.node;
    let mut words = vec![format!("{:<16} {:<6}", node.path.display(), node.kind.name())];
    if node.vendor_id != 0 {
        words.push(format!("{:04x}:{:04x}", node.vendor_id, node.product_id));
    }
    words.extend(node.interface.map(|interface| format!("interface {interface}")));
    words.extend(node.usages.first().map(|(page, usage)| format!("usage {page:04x}:{usage:04x}")));
    words.extend([&node.product, &node.serial].into_iter().filter(|text| !text.is_empty()).map(|text| format!("\"{text}\"")));
    words.extend(node.by_id.as_ref().map(|name| name.display().to_string()));
    words.push(match (found.profiles.as_slice(), found.beside.as_slice()) {
        ([], []) => "no profile".to_owned(),
        ([], beside) => format!("beside {}", beside.join(", ")),
        (profiles, _) => format!("profile {}", profiles.join(", ")),
    });
    if !found.permitted {
        words.push("no permission".to_owned());
    }
    words.extend(found.holders.iter().map(|holder| format!("held by {} ({})", holder.name, holder.pid)));
    words.join("  ")
}

pub(super) fn node_json(found: &Attached, root: &Root) -> Value {
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
