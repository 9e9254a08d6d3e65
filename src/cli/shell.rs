//! `lodestone completions` and `lodestone man`: what a shell and `man` want to know of
//! the command line, made of its own description.

use std::path::PathBuf;

use clap_complete::Shell;

use super::exit::Exit;
use super::output::{self, failed, say};
use crate::platform::disk::Disk;

/// Print what completes this program's commands and flags in a shell
///
/// For bash: `lodestone completions bash > ~/.local/share/bash-completion/completions/lodestone`.
#[derive(Debug, clap::Args)]
pub struct Completions {
    /// The shell to print it for
    #[arg(ignore_case = true)]
    shell: Shell,
}

/// Print the manual page, or write all of them into a folder
#[derive(Debug, clap::Args)]
pub struct Man {
    /// The command whose page is printed; the program's own if none is named
    command: Option<String>,
    /// Write the pages of the program and of all its commands into this folder, as in
    /// ~/.local/share/man/man1
    #[arg(short, long, value_name = "DIR", conflicts_with = "command")]
    output: Option<PathBuf>,
}

const NAME: &str = "lodestone";

/// Prints the completions of a command line.
pub fn completions(arguments: Completions, mut program: clap::Command) -> Exit {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, NAME, &mut text);
    output::print(&String::from_utf8_lossy(&text), Exit::Done)
}

/// Prints or writes the pages of a command line.
pub fn man(arguments: Man, program: clap::Command) -> Exit {
    match pages(program) {
        Err(error) => failed(&error),
        Ok(pages) => match (&arguments.output, &arguments.command) {
            (Some(folder), _) => write(folder, &pages),
            (None, wanted) => {
                let wanted = wanted.as_ref().map_or(NAME.to_string(), |name| format!("{NAME}-{name}"));
                match pages.iter().find(|(name, _)| name.eq_ignore_ascii_case(&wanted)) {
                    Some((_, page)) => output::print(page, Exit::Done),
                    None => {
                        let names: Vec<&str> =
                            pages.iter().filter_map(|(name, _)| name.strip_prefix("lodestone-")).collect();
                        output::complain(format_args!(
                            "there is no page {wanted}; there are {}",
                            names.join(", ")
                        ));
                        Exit::Usage
                    }
                }
            }
        },
    }
}

/// The pages of the program and of its commands, by their names.
fn pages(mut program: clap::Command) -> std::io::Result<Vec<(String, String)>> {
    program.build();
    let mut pages = vec![(NAME.to_string(), page(program.clone())?)];
    for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
        let name = format!("{NAME}-{}", command.get_name());
        let command = command.clone().version(env!("CARGO_PKG_VERSION")).display_name(name.clone());
        pages.push((name, page(command)?));
    }
    Ok(pages)
}

fn page(command: clap::Command) -> std::io::Result<String> {
    let mut page = Vec::new();
    clap_mangen::Man::new(with_variables(command)).render(&mut page)?;
    Ok(String::from_utf8_lossy(&page).into_owned())
}

/// Tells of each flag which variable of the environment stands for it.
fn with_variables(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|argument| {
        let variable = argument.get_env().map(|name| format!(" [env: {}]", name.to_string_lossy()));
        let (Some(variable), Some(help)) = (variable, argument.get_help().map(ToString::to_string)) else {
            return argument;
        };
        argument.help(help + &variable)
    });
    command.mut_subcommands(with_variables)
}

fn write(folder: &std::path::Path, pages: &[(String, String)]) -> Exit {
    let disk = Disk::new();
    let written = disk.create_dir_all(folder).and_then(|()| {
        pages.iter().try_for_each(|(name, page)| {
            disk.write_atomic(&folder.join(format!("{name}.1")), page.as_bytes())
        })
    });
    match written {
        Ok(()) => {
            say!("{} pages are in {}", pages.len(), folder.display());
            Exit::Done
        }
        Err(error) => failed(&error),
    }
}
