//! Prints a scenario as TOML, and the description of all that a scenario may hold. Both are files that can be read
//! back; of the description once what must be there is filled in.

use super::Scenario;
use super::keys::{Allowed, Choice, Keys};
use std::fmt::Write;
use std::path::PathBuf;

/// The scenario with every key.
pub(super) fn scenario(scenario: &Scenario) -> String {
    print(&mut scenario.clone(), false)
}

/// Every key with default, range and meaning; variants that are not the default are comments.
pub(super) fn schema() -> String {
    print(&mut Scenario::default(), true)
}

fn print(scenario: &mut Scenario, explained: bool) -> String {
    let mut text = String::new();
    let mut printer = Printer {
        text: &mut text,
        tables: String::new(),
        prefix: String::new(),
        explained,
        comment: false,
    };
    scenario.keys(&mut printer);
    let tables = printer.tables;
    text.push_str(&tables);
    text
}

/// A basic string of TOML.
fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", c as u32);
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

struct Printer<'a> {
    text: &'a mut String,
    /// Tables below this one: in TOML they come after its own keys.
    tables: String,
    prefix: String,
    /// Whether meaning and range are printed.
    explained: bool,
    /// Whether what is printed does not hold: another variant's keys.
    comment: bool,
}

impl Printer<'_> {
    fn entry(&mut self, key: &str, value: Option<&str>, allowed: &str, about: &str) {
        let mark = if self.comment || value.is_none() {
            "# "
        } else {
            ""
        };
        let line = format!("{mark}{key} = {}", value.unwrap_or("..."));
        // Writing to a string cannot fail.
        let _ = match (self.explained, allowed) {
            (false, _) if value.is_none() => Ok(()),
            (false, _) => writeln!(self.text, "{line}"),
            (true, "") => writeln!(self.text, "{line:40} # {about}"),
            (true, _) => writeln!(self.text, "{line:40} # {about}; {allowed}"),
        };
    }

    fn float(value: f64) -> Option<String> {
        (!value.is_nan()).then(|| format!("{value:?}"))
    }

    fn nested(&mut self, heading: &str, about: &str, section: &mut dyn FnMut(&mut dyn Keys)) {
        let mark = if self.comment { "# " } else { "" };
        let mut text = match self.explained {
            true => format!("\n# {about}\n{mark}{heading}\n"),
            false => format!("\n{mark}{heading}\n"),
        };
        let mut printer = Printer {
            text: &mut text,
            tables: String::new(),
            prefix: heading.trim_matches(['[', ']']).to_owned() + ".",
            explained: self.explained,
            comment: self.comment,
        };
        section(&mut printer);
        let below = printer.tables;
        self.tables.push_str(&text);
        self.tables.push_str(&below);
    }
}

impl Keys for Printer<'_> {
    fn number(
        &mut self,
        key: &'static str,
        value: &mut f64,
        allowed: Allowed,
        about: &'static str,
    ) {
        let allowed = match value.is_nan() {
            true => format!("{allowed}; must be there"),
            false => allowed.to_string(),
        };
        self.entry(key, Self::float(*value).as_deref(), &allowed, about);
    }

    fn optional(
        &mut self,
        key: &'static str,
        value: &mut Option<f64>,
        allowed: Allowed,
        about: &'static str,
    ) {
        let value = value.and_then(Self::float);
        self.entry(key, value.as_deref(), &allowed.to_string(), about);
    }

    fn numbers(
        &mut self,
        key: &'static str,
        values: &mut [f64],
        allowed: Allowed,
        about: &'static str,
    ) {
        let value = format!("{values:?}");
        self.entry(key, Some(&value), &allowed.to_string(), about);
    }

    fn count(
        &mut self,
        key: &'static str,
        value: &mut u64,
        (least, most): (u64, u64),
        about: &'static str,
    ) {
        let allowed = format!("a whole number from {least} to {most}");
        self.entry(key, Some(&value.to_string()), &allowed, about);
    }

    fn flag(&mut self, key: &'static str, value: &mut bool, about: &'static str) {
        self.entry(key, Some(&value.to_string()), "true or false", about);
    }

    fn file(&mut self, key: &'static str, value: &mut PathBuf, about: &'static str) {
        let quoted = quoted(&value.to_string_lossy());
        let there = !value.as_os_str().is_empty();
        let allowed = "relative to the scenario's folder; must be there";
        self.entry(key, there.then_some(quoted.as_str()), allowed, about);
    }

    fn table(
        &mut self,
        key: &'static str,
        about: &'static str,
        section: &mut dyn FnMut(&mut dyn Keys),
    ) {
        let heading = format!("[{}{key}]", self.prefix);
        self.nested(&heading, about, section);
    }

    fn rows(
        &mut self,
        key: &'static str,
        about: &'static str,
        rows: usize,
        row: &mut dyn FnMut(usize, &mut dyn Keys),
    ) {
        let heading = format!("[[{}{key}]]", self.prefix);
        for i in 0..rows {
            self.nested(&heading, about, &mut |keys| row(i, keys));
        }
        if self.explained && rows == 0 {
            let comment = std::mem::replace(&mut self.comment, true);
            self.nested(&heading, about, &mut |keys| row(0, keys));
            self.comment = comment;
        }
    }

    fn choice(&mut self, choice: Choice<'_>) {
        let name = format!("\"{}\"", choice.names[choice.chosen]);
        let must = if choice.required {
            "; must be there"
        } else {
            ""
        };
        let allowed = format!("one of {}{must}", choice.names.join(", "));
        self.entry(choice.key, Some(&name), &allowed, choice.about);
        (choice.variant)(choice.chosen, self);
        if !self.explained {
            return;
        }
        let comment = std::mem::replace(&mut self.comment, true);
        for (index, name) in choice.names.iter().enumerate() {
            if index == choice.chosen {
                continue;
            }
            let (text, tables) = (self.text.len(), self.tables.len());
            let _ = writeln!(self.text, "# with {} = \"{name}\":", choice.key);
            let heading = self.text.len();
            (choice.variant)(index, self);
            if self.text.len() == heading && self.tables.len() == tables {
                self.text.truncate(text);
            }
        }
        self.comment = comment;
    }
}
