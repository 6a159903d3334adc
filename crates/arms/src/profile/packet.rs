//! Frames described as data: `[packet]`, and the files in `packets` for codecs that several profiles
//! share, into a [`PacketLayout`]. What fits together is checked by the layout itself.

use super::Profile;
use super::written::{
    CodecWord, Field as WrittenField, FramingWord, NumberWord, Packet as WrittenPacket, Packets,
    ProfileFile, RoleWord,
};
use crate::Pacing;
use crate::protocol::PacketLayout;
use crate::protocol::layout::{
    Checksum, Field, Framing, LineFraming, LinePad, Number, Packet, Role,
};
use document::Checks;

/// The layout that a profile describes; `None` when a packet could not be made of it.
pub(super) fn written(
    checks: &mut Checks<'_>,
    written: &ProfileFile,
    profile: &Profile,
) -> Option<PacketLayout> {
    let accepted = "tables [packet.report] and [packet.command] that describe the frames";
    let packets = checks.given("packet", written.packet.as_ref(), accepted)?;
    layout(checks, packets, "declarative", profile.link.pacing, profile)
}

/// The layout of a codec that is described beside this file; `constant`: of the field that leaves
/// it open.
pub(super) fn known(
    checks: &mut Checks<'_>,
    codec: CodecWord,
    constant: Option<u32>,
    profile: &Profile,
) -> Option<PacketLayout> {
    let (name, pacing, text) = match codec {
        CodecWord::WoodenhapticsHid8 => {
            ("woodenhaptics-hid8", Pacing::Stream, include_str!("packets/woodenhaptics-hid8.toml"))
        }
        CodecWord::PolhemAscii64 => {
            ("polhem-ascii64", Pacing::PingPong, include_str!("packets/polhem-ascii64.toml"))
        }
        CodecWord::HaptikfabrikenBrackets => (
            "haptikfabriken-brackets",
            Pacing::PingPong,
            include_str!("packets/haptikfabriken-brackets.toml"),
        ),
        _ => return None,
    };
    let mut packets: Packets = toml::from_str(text).unwrap_or_default();
    let fields = packets.report.iter_mut().flat_map(|report| &mut report.fields);
    for field in fields.filter(|field| field.role == Some(RoleWord::Constant)) {
        field.value = field.value.or(constant.map(i64::from));
    }
    layout(checks, &packets, name, pacing, profile)
}

fn layout(
    checks: &mut Checks<'_>,
    packets: &Packets,
    name: &'static str,
    pacing: Pacing,
    profile: &Profile,
) -> Option<PacketLayout> {
    let accepted = "a table [packet.report] that describes what the arm sends";
    let report = checks.given("packet.report", packets.report.as_ref(), accepted)?;
    let report = packet(checks, "packet.report", report);
    let command = packets.command.as_ref().map(|command| packet(checks, "packet.command", command));
    let kick = packets.kick_hex.as_ref().map(|hex| hex_bytes(checks, "packet.kick_hex", hex));
    Some(PacketLayout {
        name,
        report: report?,
        command: match command {
            Some(command) => Some(command?),
            None => None,
        },
        kick: kick.flatten(),
        pacing,
        watchdog_ms: profile.link.device_watchdog_ms,
    })
}

fn packet(checks: &mut Checks<'_>, at: &str, written: &WrittenPacket) -> Option<Packet> {
    let framing = framing(checks, at, written);
    let fields: Vec<Option<Field>> = written
        .fields
        .iter()
        .enumerate()
        .map(|(idx, field)| self::field(checks, &format!("{at}.fields[{idx}]"), field))
        .collect();
    if written.fields.is_empty() {
        checks.missing(
            &format!("{at}.fields"),
            "what is in the packet, such as [{ role = \"reading\", index = 0, offset = 0, type = \
                \"i16\" }]",
        );
    }
    let checksum = written.checksum.map(|word| Checksum {
        kind: word.into(),
        big_endian: written.checksum_big_endian.unwrap_or(false),
    });
    Some(Packet { framing: framing?, checksum, fields: fields.into_iter().collect::<Option<_>>()? })
}

fn framing(checks: &mut Checks<'_>, at: &str, written: &WrittenPacket) -> Option<Framing> {
    let accepted = "\"report\", \"sync\", \"cobs\", \"slip\" or \"line\"";
    let word = checks.given(&format!("{at}.framing"), written.framing, accepted)?;
    // Each key with the framings that have it; what another one has would silently do nothing.
    let binary = [FramingWord::Report, FramingWord::Sync, FramingWord::Cobs, FramingWord::Slip];
    let keys: [(&str, bool, &[FramingWord]); 10] = [
        ("length", written.length.is_some(), &binary),
        ("checksum", written.checksum.is_some(), &binary),
        ("report_id", written.report_id.is_some(), &[FramingWord::Report]),
        ("sync_hex", written.sync_hex.is_some(), &[FramingWord::Sync]),
        ("checksum_covers_sync", written.checksum_covers_sync.is_some(), &[FramingWord::Sync]),
        ("open", written.open.is_some(), &[FramingWord::Line]),
        ("separator", written.separator.is_some(), &[FramingWord::Line]),
        ("close", written.close.is_some(), &[FramingWord::Line]),
        ("pad_length", written.pad_length.is_some(), &[FramingWord::Line]),
        ("pad_byte", written.pad_byte.is_some(), &[FramingWord::Line]),
    ];
    for (key, _, _) in
        keys.into_iter().filter(|(_, is_written, of)| *is_written && !of.contains(&word))
    {
        checks.not_accepted(
            &format!("{at}.{key}"),
            format_args!("left out: framing \"{}\" has none", word),
        );
    }
    if word != FramingWord::Line && written.length.is_none() {
        checks.missing(&format!("{at}.length"), "the bytes of the body, checksum included");
        return None;
    }
    let len = written.length.unwrap_or_default() as usize;
    Some(match word {
        FramingWord::Report => Framing::Report {
            id: written
                .report_id
                .map(|id| checks.whole(&format!("{at}.report_id"), Some(id), 1, 1, 255) as u8),
            len,
        },
        FramingWord::Sync => {
            let key = format!("{at}.sync_hex");
            let hex = checks.given(
                &key,
                written.sync_hex.as_ref(),
                "the bytes before the body, such as \"AA 55\"",
            )?;
            Framing::Sync {
                sync: hex_bytes(checks, &key, hex)?,
                len,
                covers_sync: written.checksum_covers_sync.unwrap_or(false),
            }
        }
        FramingWord::Cobs => Framing::Cobs { len },
        FramingWord::Slip => Framing::Slip { len },
        FramingWord::Line => Framing::Line(LineFraming {
            open: written.open.clone().unwrap_or_default(),
            separator: match written.separator.as_deref().map(str::as_bytes) {
                None => b' ',
                Some([separator]) => *separator,
                Some(_) => {
                    checks.not_accepted(
                        &format!("{at}.separator"),
                        "one ASCII character, such as \",\"",
                    );
                    return None;
                }
            },
            close: written.close.clone().unwrap_or_else(|| "\n".to_owned()),
            pad: written.pad_length.map(|len| LinePad {
                byte: checks.whole(&format!("{at}.pad_byte"), written.pad_byte, 32, 0, 32) as u8,
                len: len as usize,
                before_close: written.pad_before_close.unwrap_or(false),
            }),
        }),
    })
}

fn field(checks: &mut Checks<'_>, at: &str, written: &WrittenField) -> Option<Field> {
    let index = written.index.unwrap_or_default() as usize;
    let accepted = "what the number is, such as \"reading\" or \"motor\"";
    let role = match checks.given(&format!("{at}.role"), written.role, accepted)? {
        RoleWord::Reading => Role::Reading(index),
        RoleWord::Rate => Role::Rate(index),
        RoleWord::Buttons => Role::Buttons(u8::try_from(index).unwrap_or(u8::MAX)),
        RoleWord::Counter => Role::Counter,
        RoleWord::Error => Role::Error,
        RoleWord::Homed => Role::Homed,
        RoleWord::Motor => Role::Motor(index),
        RoleWord::Enabled => Role::Enabled,
        RoleWord::Constant => Role::Constant(written.value.unwrap_or_default()),
        RoleWord::Ignored => Role::Ignored,
    };
    if matches!(role, Role::Constant(_)) != written.value.is_some() {
        checks.not_accepted(at, "with `value` exactly for role \"constant\"");
    }
    if matches!(role, Role::Reading(_) | Role::Rate(_) | Role::Motor(_)) && written.index.is_none()
    {
        checks.missing(&format!("{at}.index"), "which one, from 0");
    }
    let accepted = "the first byte in the body, or which number of the line, from 0";
    let offset = checks.given(&format!("{at}.offset"), written.offset, accepted)?;
    let accepted = "\"i16\", \"f32\", \"text\" …: how the number is written";
    let number = match checks.given(&format!("{at}.type"), written.kind, accepted)? {
        NumberWord::I8 => Number::I8,
        NumberWord::U8 => Number::U8,
        NumberWord::I16 => Number::I16,
        NumberWord::U16 => Number::U16,
        NumberWord::I32 => Number::I32,
        NumberWord::U32 => Number::U32,
        NumberWord::F32 => Number::F32,
        NumberWord::F64 => Number::F64,
        NumberWord::Text => Number::Text {
            places: checks.whole(&format!("{at}.places"), written.places, 0, 0, 9) as u8,
        },
    };
    Some(Field {
        role,
        offset: offset as usize,
        number,
        big_endian: written.big_endian.unwrap_or(false),
        scale: written.scale.unwrap_or(1.0),
        mask: written.mask,
        wraps: written.wraps.unwrap_or(false),
        limit: written.limit,
    })
}

/// Bytes written as hexadecimal pairs.
pub(super) fn hex_bytes(checks: &mut Checks<'_>, key: &str, hex: &str) -> Option<Vec<u8>> {
    let bytes: Option<Vec<u8>> = hex
        .split_whitespace()
        .map(|pair| u8::from_str_radix(pair, 16).ok().filter(|_| pair.len() == 2))
        .collect();
    if bytes.as_ref().is_none_or(Vec::is_empty) {
        checks.not_accepted(
            key,
            "bytes as pairs of hexadecimal digits with blanks between, such as \"AA 55\"",
        );
        return None;
    }
    bytes
}
