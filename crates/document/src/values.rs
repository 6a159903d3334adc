//! Values as they are written, with messages for users who know no Rust: words out of a list,
//! arrays of numbers.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::{self, Deserializer, IgnoredAny, SeqAccess, Visitor};

/// An array of exactly N numbers. (An array type would let a longer one pass.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Array<const N: usize>;
        impl<'de, const N: usize> Visitor<'de> for Array<N> {
            type Value = Numbers<N>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "an array of {N} numbers")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Numbers<N>, A::Error> {
                let mut numbers = [0.0; N];
                for (count, number) in numbers.iter_mut().enumerate() {
                    *number = seq
                        .next_element()?
                        .ok_or_else(|| de::Error::invalid_length(count, &self))?;
                }
                match seq.next_element::<IgnoredAny>()? {
                    None => Ok(Numbers(numbers)),
                    Some(_) => Err(de::Error::invalid_length(N + 1, &self)),
                }
            }
        }
        deserializer.deserialize_any(Array::<N>)
    }
}

impl<const N: usize> JsonSchema for Numbers<N> {
    fn schema_name() -> Cow<'static, str> {
        format!("Numbers{N}").into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": N, "maxItems": N })
    }
}

/// Enums that are written as strings. Derived messages would speak of "variants" and "maps" to a
/// user who wrote a number. `for TYPE`: each becomes the variant of that name of another enum.
#[macro_export]
macro_rules! words {
    () => {};
    ($name:ident for $domain:ident $variants:tt $($rest:tt)*) => {
        $crate::words! { @into $domain, $name $variants }
        $crate::words! { $name $variants $($rest)* }
    };
    ($name:ident { $($variant:ident = $word:literal),+ $(,)? } $($rest:tt)*) => {
        $crate::words! { $($rest)* }

        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $($variant),+ }

        impl $name {
            const WORDS: &[&str] = &[$($word),+];
        }

        impl core::fmt::Display for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str(match self { $(Self::$variant => $word),+ })
            }
        }

        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }
            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!({ "type": "string", "enum": [$($word),+] })
            }
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Words;
                impl serde::de::Visitor<'_> for Words {
                    type Value = $name;
                    fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                        f.write_str(&$crate::any_of($name::WORDS))
                    }
                    fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<$name, E> {
                        match word {
                            $($word => Ok($name::$variant),)+
                            _ => Err(E::unknown_variant(word, $name::WORDS)),
                        }
                    }
                }
                deserializer.deserialize_any(Words)
            }
        }
    };
    (@into $domain:ident, $name:ident { $($variant:ident = $word:literal),+ $(,)? }) => {
        impl From<$name> for $domain {
            fn from(word: $name) -> Self {
                match word { $($name::$variant => Self::$variant),+ }
            }
        }
    };
}
