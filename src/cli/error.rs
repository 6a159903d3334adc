//! Why a command ends: what is wrong, what to do about it, and the exit code.

use std::fmt::Display;
use std::io;

use super::{OutputOptions, destination, network, report};
use crate::config::ConfigErrors;
use crate::daemon::PrepareError;
use crate::error::Exit;
use crate::scene::SceneError;
use arms::profile::ProfileError;
use link::network::NetworkError;
use vps::storage::printable::one_line;

/// How a command ends.
pub(crate) type Outcome = Result<Exit, CliError>;

/// Why a command did not do what was asked for.
#[derive(Debug)]
pub(crate) struct CliError {
    exit: Exit,
    /// Each with what to do about it.
    messages: Vec<(String, Option<String>)>,
}

impl CliError {
    pub(crate) fn new(exit: Exit, message: impl Display) -> Self {
        Self { exit, messages: vec![(message.to_string(), None)] }
    }

    pub(crate) fn usage(message: impl Display) -> Self {
        Self::new(Exit::Usage, message)
    }

    pub(crate) fn configuration(message: impl Display) -> Self {
        Self::new(Exit::Configuration, message)
    }

    pub(crate) fn asset(message: impl Display) -> Self {
        Self::new(Exit::Asset, message)
    }

    pub(crate) fn device(message: impl Display) -> Self {
        Self::new(Exit::Device, message)
    }

    pub(crate) fn internal(message: impl Display) -> Self {
        Self::new(Exit::Internal, message)
    }

    /// A file that cannot be written.
    pub(crate) fn write(file: impl Display, error: &io::Error) -> Self {
        Self::asset(format_args!("cannot write {file}: {error}")).hint(destination::hint(error))
    }

    /// A thread that cannot be started.
    pub(crate) fn thread(error: io::Error) -> Self {
        Self::internal(format_args!("cannot start a thread: {error}"))
    }

    /// What to do about it.
    pub(crate) fn hint<'h>(mut self, hint: impl Into<Option<&'h str>>) -> Self {
        if let (Some((_, known)), Some(hint)) = (self.messages.last_mut(), hint.into()) {
            *known = Some(hint.to_owned());
        }
        self
    }

    /// The same with another exit code.
    pub(crate) fn exit(self, exit: Exit) -> Self {
        Self { exit, ..self }
    }

    /// Prints it and gives its exit code.
    pub(crate) fn report(&self, output: OutputOptions) -> Exit {
        for (message, hint) in &self.messages {
            report::error(message, hint.as_deref(), output);
        }
        self.exit
    }
}

impl From<&ConfigErrors> for CliError {
    fn from(errors: &ConfigErrors) -> Self {
        let message = |problem: &crate::config::Problem| {
            (one_line(&problem.to_string()).into_owned(), problem.hint())
        };
        let messages = errors.problems().iter().map(message).collect();
        Self { exit: Exit::Configuration, messages }
    }
}

impl From<&SceneError> for CliError {
    fn from(error: &SceneError) -> Self {
        // What a mesh file says of itself may be in it.
        Self::new(report::scene_exit(error), one_line(&error.to_string()))
            .hint(error.hint().as_deref())
    }
}

impl From<&PrepareError> for CliError {
    fn from(error: &PrepareError) -> Self {
        if let PrepareError::Config(errors) = error {
            return errors.into();
        }
        Self::new(report::prepare_exit(error), one_line(&error.to_string()))
            .hint(report::prepare_hint(error).as_deref())
    }
}

impl From<&ProfileError> for CliError {
    fn from(error: &ProfileError) -> Self {
        match error {
            ProfileError::Invalid(errors) => errors.into(),
            error => Self::configuration(error),
        }
    }
}

impl From<&NetworkError> for CliError {
    fn from(error: &NetworkError) -> Self {
        Self::new(network::exit_of(error), error)
    }
}

macro_rules! by_value {
    ($($error:ty),+) => {$(
        impl From<$error> for CliError {
            fn from(error: $error) -> Self {
                Self::from(&error)
            }
        }
    )+};
}
by_value!(ConfigErrors, SceneError, PrepareError, ProfileError, NetworkError);
