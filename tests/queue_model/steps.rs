//! The steps of a history, and its end.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use lodestone::platform::disk::Disk;
use lodestone::serve::job::Event;
use lodestone::serve::job::State;
use lodestone::serve::job::state_machine;
use lodestone::serve::queue::StoreError;

use crate::Broken;
use crate::content::{self, CONTENTS};
use crate::dice::Dice;
use crate::world::{Life, World};

/// More polls than any future of the daemon takes.
const TO_THE_END: usize = usize::MAX;
const DAY: i64 = 86_400_000;

/// Does one step by chance; what it was, in words.
pub fn step(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    match dice.below(100) {
        0..14 => Ok(put(world, dice)),
        14..16 => Ok(mark(world, dice)),
        16..17 => Ok(rename_folder(world, dice)),
        17..18 => Ok(leave_behind(world, dice)),
        18..22 => Ok(delete(world, dice)),
        22..26 => Ok(rename(world, dice)),
        26..27 => Ok(touch(world, dice)),
        27..29 => Ok(swap_quietly(world, dice)),
        29..30 => Ok(half_removed(world, dice)),
        30..50 => scan(world, dice),
        50..70 => tick(world, dice),
        70..74 => {
            let millis = dice.below(20_000) as i64;
            world.advance(millis);
            Ok(format!("{millis} ms pass"))
        }
        74..77 => {
            let reach = *dice.pick(&[5_000, 100_000, DAY, 400 * DAY]);
            let millis = dice.below(2 * reach as usize) as i64 - reach;
            world.advance(millis);
            Ok(format!("the clock jumps by {millis} ms"))
        }
        77..84 => order(world, dice),
        84..86 => prioritise(world, dice),
        86..91 => let_go(world, dice),
        91..93 => Ok(toggle_mount(world)),
        93..95 => {
            world.crash();
            Ok("the daemon dies".into())
        }
        95..97 => {
            let polls = dice.below(40);
            living(world, dice).tick(polls)?;
            world.crash();
            Ok(format!("the daemon dies in a tick, after {polls} polls"))
        }
        97 => {
            world.advance(3_000);
            let (config, now, polls) = (world.config.clone(), world.now(), dice.below(12));
            living(world, dice).scan(&config, now, polls)?;
            world.crash();
            Ok(format!("the daemon dies while it takes in, after {polls} polls"))
        }
        98 => {
            world.stop();
            Ok("the daemon stops in good order".into())
        }
        99 if dice.percent(70) => meddle(world, dice),
        _ => {
            let full = !world.script.disk_full.fetch_not(Ordering::SeqCst);
            Ok(format!("the disk is full: {full}"))
        }
    }
}

/// The daemon; where it starts anew, now and then on a disk that will fail.
fn living<'a>(world: &'a mut World, dice: &mut Dice) -> &'a mut Life {
    let mut disk = Disk::new();
    if world.life.is_none() && dice.percent(15) {
        let error = *dice.pick(&[ErrorKind::StorageFull, ErrorKind::Other]);
        disk = Disk::failing_from(dice.below(4) as i64, error);
        (world.sick_disk, world.was_sick) = (true, true);
    }
    world.life(disk)
}

/// A file of a data set at a place by chance.
fn place(world: &World, dice: &mut Dice) -> PathBuf {
    let places = world.places();
    // A crowd in few places: that is where things meet.
    let place = if dice.percent(50) { &places[dice.below(2)] } else { dice.pick(&places) };
    if world.folders().contains(place) {
        // One of them on its way, as rsync has it.
        return place.join(dice.pick(&["t1.las", "t2.las", "t1.las", "t2.las", ".t2.las.Xy12Zw"]));
    }
    place.clone()
}

/// Mostly one of three, so that the same content comes back.
fn some_content(dice: &mut Dice) -> usize {
    if dice.percent(60) { dice.below(3) } else { dice.below(CONTENTS) }
}

fn put(world: &mut World, dice: &mut Dice) -> String {
    let (path, content) = (place(world, dice), some_content(dice));
    if !path.parent().is_some_and(|folder| folder.exists() || world.folders().iter().any(|f| f == folder)) {
        return "nothing: the mount is away".into();
    }
    world.write(&path, &content::bytes(content));
    format!("content {content} is put at {}", path.display())
}

/// Markers, whole, half written and wrong.
const MARKERS: [&str; 9] = [
    "{}",
    r#"{"name": "tiles"}"#,
    r#"{"name": "a"}"#,
    r#"{"priority": 3}"#,
    r#"{"on_done": "keep"}"#,
    r#"{"on_done": "delete"}"#,
    r#"{"options": {"sampling": "random"}}"#,
    r#"{"nam"#,
    r#"{"on_done": "burn"}"#,
];

/// A marker comes to a folder of tiles, before the tiles, among or after them.
fn mark(world: &mut World, dice: &mut Dice) -> String {
    let folder = dice.pick(&world.folders()).clone();
    let path = folder.join("lodestone.json");
    if dice.percent(15) {
        let done = fs::remove_file(&path).is_ok();
        return format!("{} is deleted: {done}", path.display());
    }
    let text = *dice.pick(&MARKERS);
    world.trust.asked.removal |= text.contains("delete");
    world.trust.asked.options |= text.contains("options");
    fs::create_dir_all(&folder).expect("made");
    fs::write(&path, text).expect("written");
    format!("marker {text} comes to {}", folder.display())
}

fn rename_folder(world: &mut World, dice: &mut Dice) -> String {
    let mut folders = world.folders();
    if dice.percent(50) {
        folders.reverse();
    }
    let [from, to] = folders;
    let done = fs::rename(&from, &to).is_ok();
    if done {
        let moved = |path: PathBuf| path.strip_prefix(&from).map_or(path.clone(), |within| to.join(within));
        let files = std::mem::take(&mut world.trust.files);
        world.trust.files = files.into_iter().map(|(path, content)| (moved(path), content)).collect();
    }
    format!("{} is renamed to {}: {done}", from.display(), to.display())
}

/// What systems leave beside files, which is nobody's.
fn leave_behind(world: &World, dice: &mut Dice) -> String {
    let folder = dice.pick(&world.folders()).clone();
    let path = folder.join(dice.pick(&["._t1.las", "__MACOSX/._t1.las", ".DS_Store"]));
    if !folder.exists() {
        return "nothing: no folder to leave anything in".into();
    }
    fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    fs::write(&path, b"\0\x05\x16\x07\0\x02\0\0Mac OS X        ").expect("written");
    format!("{} is left behind", path.display())
}

fn delete(world: &mut World, dice: &mut Dice) -> String {
    let path = place(world, dice);
    if fs::remove_file(&path).is_ok() {
        world.trust.files.remove(&path);
    }
    format!("{} is deleted", path.display())
}

fn rename(world: &mut World, dice: &mut Dice) -> String {
    let (from, to) = (place(world, dice), place(world, dice));
    let done = fs::rename(&from, &to).is_ok();
    if done && let Some(content) = world.trust.files.remove(&from) {
        world.trust.files.insert(to.clone(), content);
    }
    format!("{} is renamed to {}: {done}", from.display(), to.display())
}

fn touch(world: &mut World, dice: &mut Dice) -> String {
    let path = place(world, dice);
    if path.exists() {
        world.touch(&path);
    }
    format!("{} is touched", path.display())
}

/// Other content of the same size and time, as a copy that keeps times brings it; best
/// to what was converted and is about to be removed.
fn swap_quietly(world: &mut World, dice: &mut Dice) -> String {
    let now = world.now();
    let owed: Vec<PathBuf> = world.life.as_ref().map_or_else(Vec::new, |life| {
        let jobs = life.runtime.block_on(life.store.sources_owed(now, 0, 10)).expect("answers");
        let inputs = |id| life.runtime.block_on(life.store.inputs(id)).expect("answers");
        jobs.iter().flat_map(|(job, _)| inputs(job.id)).map(|input| input.path).collect()
    });
    let path = if owed.is_empty() { place(world, dice) } else { dice.pick(&owed).clone() };
    let alike = content::ALIKE.map(content::bytes);
    let (Ok(there), Ok(meta)) = (fs::read(&path), fs::metadata(&path)) else {
        return "nothing to swap".into();
    };
    let Some(at) = alike.iter().position(|bytes| *bytes == there) else { return "nothing alike".into() };
    // The times of change tick in hundredths.
    std::thread::sleep(std::time::Duration::from_millis(11));
    fs::write(&path, &alike[1 - at]).expect("written");
    let file = fs::OpenOptions::new().append(true).open(&path).expect("there");
    file.set_modified(meta.modified().expect("a time")).expect("set");
    world.trust.files.insert(path.clone(), content::hash(&alike[1 - at]));
    format!("{} gets other content of the same size and time", path.display())
}

/// The daemon dies when it has removed one of the files that it is to remove.
fn half_removed(world: &mut World, dice: &mut Dice) -> String {
    let now = world.now();
    let life = living(world, dice);
    let owed = life.runtime.block_on(life.store.sources_owed(now, 0, 10)).expect("answers");
    let inputs = owed.first().map(|(job, _)| {
        (job.name.clone(), life.runtime.block_on(life.store.inputs(job.id)).expect("answers"))
    });
    let Some((name, inputs)) = inputs else { return "nothing to remove".into() };
    let shown =
        fs::read_to_string(world.config.octrees().join(name).join("metadata.json")).unwrap_or_default();
    world.crash();
    if let Some(input) = inputs.first().filter(|_| inputs.len() > 1)
        && let Ok(bytes) = fs::read(&input.path)
        && shown.split(',').any(|hash| hash == content::hash(&bytes))
    {
        fs::remove_file(&input.path).expect("removed");
        return format!("the daemon dies when it has removed {}", input.path.display());
    }
    "the daemon dies".into()
}

/// Somebody puts a folder among the octrees, in place of one or under a name to
/// come, or the database is lost.
fn meddle(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    let octrees = world.config.octrees();
    if dice.percent(30) {
        world.crash();
        for end in ["", "-wal", "-shm"] {
            let mut path = world.config.database().into_os_string();
            path.push(end);
            let _ = fs::remove_file(path);
        }
        let path = world.config.root.join("scratch");
        let _ = fs::remove_dir_all(&path);
        fs::create_dir(&path).expect("made");
        let _ = fs::remove_dir_all(octrees.join(".staged"));
        fs::create_dir(octrees.join(".staged")).expect("made");
        world.forget();
        return Ok("the database is lost".into());
    }
    let folder = octrees.join(dice.pick(&["a", "b", "tiles", "a-2", "größe 1"]));
    let own = format!("somebody's own {}", dice.below(1000));
    if let Ok(shown) = fs::read_to_string(folder.join("metadata.json")) {
        if world.trust.foreign.contains_key(&folder) {
            return Ok("nothing: it is somebody's own already".into());
        }
        fs::remove_dir_all(&folder).expect("removed");
        for file in shown.split(',') {
            world.trust.removed.remove(file);
        }
    }
    fs::create_dir_all(&folder).expect("made");
    fs::write(folder.join("metadata.json"), &own).expect("written");
    let text = format!("{} is {own}", folder.display());
    world.trust.foreign.insert(folder, own);
    world.trust.meddled = true;
    Ok(text)
}

fn scan(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    // Mostly two scans with the settle time between them, so that something
    // is found.
    let config = world.config.clone();
    let pauses = if dice.percent(70) { vec![0, 2_500] } else { vec![dice.below(4_000) as i64] };
    for pause in &pauses {
        world.advance(*pause);
        let now = world.now();
        living(world, dice).scan(&config, now, TO_THE_END)?;
    }
    Ok(format!("scans, after {pauses:?} ms"))
}

fn tick(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    let ticks = 1 + dice.below(2);
    for _ in 0..ticks {
        living(world, dice).tick(TO_THE_END)?;
    }
    Ok(format!("ticks: {ticks}"))
}

fn order(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    let event = *dice.pick(&[Event::Cancel, Event::Pause, Event::Resume, Event::Retry]);
    let now = world.now();
    let life = living(world, dice);
    let jobs = life.jobs();
    if jobs.is_empty() {
        return scan(world, dice);
    }
    let job = dice.pick(&jobs);
    let answer = life.runtime.block_on(life.store.order(job.id, event, now));
    match &answer {
        Ok(_) if state_machine::next(job.state, event).is_none() => {
            return Err(format!("{event:?} of a {:?} job was obeyed", job.state));
        }
        Ok(_) => {}
        Err(StoreError::Illegal { .. }) => {}
        Err(error) => return Err(format!("{event:?}: {error}")),
    }
    if answer.is_ok() {
        world.ordered.insert(job.id);
    }
    Ok(format!("{event:?} of job {}: {}", job.id, answer.is_ok()))
}

fn prioritise(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    let (now, priority) = (world.now(), dice.below(7) as i64 - 3);
    let life = living(world, dice);
    let jobs = life.jobs();
    if jobs.is_empty() {
        return scan(world, dice);
    }
    let job = dice.pick(&jobs).id;
    life.runtime.block_on(life.store.set_priority(job, priority, now)).map_err(|error| error.to_string())?;
    Ok(format!("priority {priority} for job {job}"))
}

fn let_go(world: &mut World, dice: &mut Dice) -> Result<String, Broken> {
    let life = living(world, dice);
    let hung = life.desk.hung();
    if hung.is_empty() {
        return tick(world, dice);
    }
    let job = *dice.pick(&hung);
    life.let_go(job);
    Ok(format!("job {job} goes on"))
}

fn toggle_mount(world: &World) -> String {
    let (here, away) = world.mount();
    if here.exists() {
        fs::rename(here, away).expect("moved");
        return "the mount is gone".into();
    }
    fs::rename(away, here).expect("moved");
    "the mount is back".into()
}

/// The faults stop, operators let everything go on, and time passes.
pub fn calm_down(world: &mut World) -> Result<(), Broken> {
    world.script.calm.store(true, Ordering::SeqCst);
    world.script.disk_full.store(false, Ordering::SeqCst);
    let (here, away) = world.mount();
    if !here.exists() {
        fs::rename(away, here).expect("moved");
    }
    if world.sick_disk {
        world.crash();
    }
    let config = world.config.clone();
    // A day would do as well; this covers the longest wait a few times over.
    for round in 0..40 {
        world.advance(if round % 4 == 3 { 700_000 } else { 2_500 });
        let now = world.now();
        let life = world.life(Disk::new());
        for job in life.jobs_in(State::Paused) {
            let resumed = life.runtime.block_on(life.store.order(job, Event::Resume, now));
            resumed.map_err(|error| format!("job {job} cannot be resumed: {error}"))?;
        }
        for job in life.desk.hung() {
            life.let_go(job);
        }
        let report = life.scan(&config, now, TO_THE_END)?.expect("not cut off");
        life.tick(TO_THE_END)?;
        life.tick(TO_THE_END)?;
        let waits = life.jobs().iter().any(|job| {
            matches!(job.state, State::Queued | State::Running | State::Paused) && job.hold.is_none()
        });
        let waiting = life.runtime.block_on(life.store.previews_waiting());
        let waits = waits || waiting.map_err(|error| error.to_string())? > 0;
        if round > 8 && !waits && !report.unsettled {
            break;
        }
    }
    Ok(())
}
