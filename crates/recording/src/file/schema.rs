//! The schema of a message, from its description: what lets any reader of MCAP files make sense of the bytes.

use super::fields::{Fields, Kind, Words, Writer};

/// The package of our messages.
const PACKAGE: &str = "hapticd";

/// Numbers of protobuf's own `descriptor.proto`.
mod kind {
    pub(super) const DOUBLE: u64 = 1;
    pub(super) const INT64: u64 = 3;
    pub(super) const UINT64: u64 = 4;
    pub(super) const BOOL: u64 = 8;
    pub(super) const STRING: u64 = 9;
    pub(super) const MESSAGE: u64 = 11;
    pub(super) const UINT32: u64 = 13;
    pub(super) const ENUM: u64 = 14;
    /// Every field may be missing, as far as the schema says.
    pub(super) const OPTIONAL: u64 = 1;
}

/// Walks a description and writes it down; see `google/protobuf/descriptor.proto`.
#[derive(Default)]
pub(super) struct Describer {
    /// Fields of the message that is walked.
    message: Writer,
    n_fields: u64,
    /// Finished messages and enumerations of the file: field number and bytes.
    types: Vec<(u64, Vec<u8>)>,
    names: Vec<String>,
}

const MESSAGE_TYPE: u64 = 4;
const ENUM_TYPE: u64 = 5;

impl Describer {
    fn field(&mut self, name: &'static str, kind: u64, type_name: Option<&str>) {
        self.n_fields += 1;
        let mut field = Writer::default();
        field.block(1, name.as_bytes());
        field.number(3, self.n_fields);
        field.number(4, kind::OPTIONAL);
        field.number(5, kind);
        if let Some(type_name) = type_name {
            field.block(6, type_name.as_bytes());
        }
        self.message.block(2, field.bytes());
    }

    /// True when a type is seen for the first time.
    fn is_new(&mut self, type_name: &str) -> bool {
        let is_new = !self.names.iter().any(|known| known == type_name);
        if is_new {
            self.names.push(type_name.to_owned());
        }
        is_new
    }
}

impl Fields for Describer {
    fn double(&mut self, name: &'static str, _: &mut f64) {
        self.field(name, kind::DOUBLE, None);
    }

    fn whole(&mut self, name: &'static str, kind: Kind, _: &mut u64) {
        let kind = match kind {
            Kind::Short => kind::UINT32,
            Kind::Long => kind::UINT64,
            Kind::Signed => kind::INT64,
            Kind::Flag => kind::BOOL,
        };
        self.field(name, kind, None);
    }

    fn word(&mut self, name: &'static str, words: &Words, _: &mut u64) {
        self.field(name, kind::ENUM, Some(&format!(".{PACKAGE}.{}", words.type_name)));
        if self.is_new(words.type_name) {
            let mut list = Writer::default();
            list.block(1, words.type_name.as_bytes());
            for (number, word) in (0..).zip(words.names) {
                let mut value = Writer::default();
                // Words of enumerations share one space in a package.
                value.block(1, format!("{}_{word}", words.type_name).to_uppercase().replace('-', "_").as_bytes());
                value.number(2, number);
                list.block(2, value.bytes());
            }
            self.types.push((ENUM_TYPE, list.bytes().to_vec()));
        }
    }

    fn text(&mut self, name: &'static str, _: &mut String) {
        self.field(name, kind::STRING, None);
    }

    fn message<T>(&mut self, name: &'static str, type_name: &'static str, value: &mut T, body: impl Fn(&mut Self, &mut T)) {
        if type_name.starts_with('.') {
            return self.field(name, kind::MESSAGE, Some(type_name));
        }
        self.field(name, kind::MESSAGE, Some(&format!(".{PACKAGE}.{type_name}")));
        if self.is_new(type_name) {
            let (outer, n_fields) = (core::mem::take(&mut self.message), core::mem::take(&mut self.n_fields));
            self.message.block(1, type_name.as_bytes());
            body(self, value);
            let inner = core::mem::replace(&mut self.message, outer);
            self.n_fields = n_fields;
            self.types.push((MESSAGE_TYPE, inner.bytes().to_vec()));
        }
    }

    fn optional<T: Copy + Default>(&mut self, _: &mut Option<T>, inner: impl Fn(&mut Self, &mut T)) {
        inner(self, &mut T::default());
    }
}

/// The serialized `FileDescriptorSet` of a channel's message: `known` holds the files of the foreign types that it may name, `imports` their
/// names; `body` walks the message.
pub(super) fn describe(type_name: &'static str, known: &[u8], imports: &[&str], body: impl FnOnce(&mut Describer)) -> Vec<u8> {
    let mut walk = Describer::default();
    walk.message.block(1, type_name.as_bytes());
    body(&mut walk);
    walk.types.push((MESSAGE_TYPE, walk.message.bytes().to_vec()));

    let mut file = Writer::default();
    file.block(1, format!("{PACKAGE}/{type_name}.proto").as_bytes());
    file.block(2, PACKAGE.as_bytes());
    imports.iter().for_each(|import| file.block(3, import.as_bytes()));
    // In the order of their numbers.
    walk.types.sort_by_key(|(number, _)| *number);
    walk.types.iter().for_each(|(number, bytes)| file.block(*number, bytes));
    file.block(12, b"proto3");

    let mut set = Writer::default();
    set.block(1, file.bytes());
    [known, set.bytes()].concat()
}
