//! Jobs as a page lists them: filtered, searched, sorted, a page at a time.
//!
//! Which jobs are on a page is found in the index `job_listed`, which holds all
//! that is filtered and sorted by; only these are then read. Pages are told by the
//! value they begin after, not by a count, so that jobs that come and go meanwhile
//! move nothing.

use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite};

use super::{Result, Store, row};
use crate::serve::job::{Job, JobId, State};

/// A job's state as people are told it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Shown {
    In(State),
    /// Done, but another octree has its name now.
    Replaced,
    /// Taken note of.
    Dismissed,
}

impl Shown {
    /// In the order in which a page offers them.
    pub const ALL: [Shown; 9] = [
        Shown::In(State::Running),
        Shown::In(State::Queued),
        Shown::In(State::Paused),
        Shown::In(State::Done),
        Shown::In(State::Failed),
        Shown::In(State::Quarantined),
        Shown::In(State::Cancelled),
        Shown::Replaced,
        Shown::Dismissed,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Shown::In(state) => state.name(),
            Shown::Replaced => "replaced",
            Shown::Dismissed => "dismissed",
        }
    }

    pub fn parse(name: &str) -> Option<Shown> {
        Shown::ALL.into_iter().find(|shown| shown.name() == name)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sort {
    /// By number, which is by age.
    #[default]
    Age,
    Name,
    Points,
    Size,
    /// How long the last run took.
    Took,
}

impl Sort {
    pub const ALL: [Sort; 5] = [Sort::Age, Sort::Name, Sort::Points, Sort::Size, Sort::Took];

    pub fn name(self) -> &'static str {
        match self {
            Sort::Age => "age",
            Sort::Name => "name",
            Sort::Points => "points",
            Sort::Size => "size",
            Sort::Took => "took",
        }
    }

    pub fn parse(name: &str) -> Option<Sort> {
        Sort::ALL.into_iter().find(|sort| sort.name() == name)
    }

    /// Its column; with a value for every job, since NULL compares with nothing.
    fn column(self) -> &'static str {
        match self {
            Sort::Age => "id",
            Sort::Name => "name",
            Sort::Points => "points",
            Sort::Size => "bytes",
            Sort::Took => "coalesce(took, -1)",
        }
    }
}

/// Which jobs, in which order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Listing {
    /// All but the dismissed ones where nothing is said.
    pub shown: Option<Shown>,
    /// Part of the name, in any letter case of ASCII.
    pub search: String,
    pub sort: Sort,
    pub ascending: bool,
}

/// A place in a listing: the value of a job that is sorted by, and its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListingCursor {
    pub value: String,
    pub id: JobId,
    /// Whether what stands before it is meant, not what comes after.
    pub backward: bool,
}

impl ListingCursor {
    /// As it stands in an address.
    pub fn to_text(&self) -> String {
        format!("{}~{}~{}", if self.backward { "before" } else { "after" }, self.id, self.value)
    }

    pub fn parse(text: &str) -> Option<ListingCursor> {
        let mut parts = text.splitn(3, '~');
        let backward = match parts.next()? {
            "before" => true,
            "after" => false,
            _ => return None,
        };
        let id = parts.next()?.parse().ok()?;
        Some(ListingCursor { value: parts.next()?.to_string(), id, backward })
    }
}

/// One page of a listing.
#[derive(Debug, Clone, Default)]
pub struct ListingPage {
    pub jobs: Vec<Job>,
    /// Where the pages before and after it are, if there are some.
    pub previous: Option<ListingCursor>,
    pub next: Option<ListingCursor>,
}

impl Store {
    pub async fn listing(
        &self,
        listing: &Listing,
        place: Option<&ListingCursor>,
        limit: i64,
    ) -> Result<ListingPage> {
        let backward = place.is_some_and(|place| place.backward);
        let ascending = listing.ascending != backward;
        let column = listing.sort.column();
        let mut query = QueryBuilder::<Sqlite>::new("SELECT id, CAST(");
        query.push(column).push(" AS TEXT) AS value FROM job");
        // The table itself is in the order of the numbers.
        if listing.shown.is_some() || !listing.search.is_empty() || listing.sort != Sort::Age {
            query.push(" INDEXED BY job_listed");
        }
        filter(&mut query, listing);
        if let Some(place) = place {
            query.push(format!(" AND ({column}, id) {} (", if ascending { ">" } else { "<" }));
            match listing.sort {
                Sort::Name => query.push_bind(place.value.clone()),
                // What is no number comes from nowhere: the listing begins with it.
                _ => query.push_bind(place.value.parse::<i64>().unwrap_or(place.id)),
            };
            query.push(", ").push_bind(place.id).push(")");
        }
        let order = if ascending { "ASC" } else { "DESC" };
        query.push(match listing.sort {
            Sort::Age => format!(" ORDER BY id {order}"),
            _ => format!(" ORDER BY {column} {order}, id {order}"),
        });
        query.push(" LIMIT ").push_bind(limit + 1);
        let rows = query.build().fetch_all(&self.readers).await?;
        // By the columns: what is told of a job may have been corrected since.
        let place_of = |row: &SqliteRow| {
            Ok(ListingCursor { value: row.try_get("value")?, id: row.try_get("id")?, backward: false })
        };
        let mut places = rows.iter().map(place_of).collect::<Result<Vec<ListingCursor>>>()?;
        let more = places.len() as i64 > limit;
        places.truncate(limit as usize);
        if backward {
            places.reverse();
        }
        let ids: Vec<JobId> = places.iter().map(|place| place.id).collect();
        let jobs = self.jobs_of(&ids).await?;
        let at = |place: Option<&ListingCursor>, backward: bool| {
            place.map(|place| ListingCursor { backward, ..place.clone() })
        };
        let (has_previous, has_next) = if backward { (more, true) } else { (place.is_some(), more) };
        Ok(ListingPage {
            previous: at(places.first(), true).filter(|_| has_previous),
            next: at(places.last(), false).filter(|_| has_next),
            jobs,
        })
    }

    /// How many jobs a listing has, of which this is a page; where nothing is searched for, `counts` of
    /// [`Store::shown_counts`] tell.
    pub async fn total(&self, listing: &Listing, page: &ListingPage, counts: &[(Shown, i64)]) -> Result<i64> {
        if page.previous.is_none() && page.next.is_none() {
            return Ok(page.jobs.len() as i64);
        }
        if listing.search.is_empty() {
            let is_in = |shown: Shown| match listing.shown {
                Some(wanted) => shown == wanted,
                None => shown != Shown::Dismissed,
            };
            return Ok(counts.iter().filter(|(shown, _)| is_in(*shown)).map(|(_, jobs)| jobs).sum());
        }
        let mut query = QueryBuilder::<Sqlite>::new("SELECT count(*) AS jobs FROM job INDEXED BY job_listed");
        filter(&mut query, listing);
        Ok(query.build().fetch_one(&self.readers).await?.try_get("jobs")?)
    }

    /// These jobs, in this order; those that are gone meanwhile are left out.
    pub async fn jobs_of(&self, ids: &[JobId]) -> Result<Vec<Job>> {
        let list = serde_json::to_string(ids).unwrap_or_default();
        let rows = sqlx::query("SELECT * FROM job WHERE id IN (SELECT value FROM json_each(?))")
            .bind(list)
            .fetch_all(&self.readers)
            .await?;
        let mut jobs = rows.iter().map(row::job).collect::<Result<Vec<Job>>>()?;
        let place = |job: &Job| ids.iter().position(|id| *id == job.id);
        jobs.sort_by_key(place);
        Ok(jobs)
    }

    /// The numbers of all jobs of a listing, the youngest first.
    pub async fn listed(&self, listing: &Listing, limit: i64) -> Result<Vec<JobId>> {
        let mut query = QueryBuilder::<Sqlite>::new("SELECT id FROM job INDEXED BY job_listed");
        filter(&mut query, listing);
        query.push(" ORDER BY id DESC LIMIT ").push_bind(limit);
        let rows = query.build().fetch_all(&self.readers).await?;
        rows.iter().map(|row| Ok(row.try_get("id")?)).collect()
    }

    /// How many jobs are shown in each state, in the order of [`Shown::ALL`].
    pub async fn shown_counts(&self) -> Result<Vec<(Shown, i64)>> {
        let rows =
            sqlx::query("SELECT shown, count(*) AS jobs FROM job INDEXED BY job_listed GROUP BY shown")
                .fetch_all(&self.readers)
                .await?;
        let mut counts = Shown::ALL.map(|shown| (shown, 0)).to_vec();
        for row in &rows {
            let (name, jobs): (String, i64) = (row.try_get("shown")?, row.try_get("jobs")?);
            counts.iter_mut().filter(|(shown, _)| shown.name() == name).for_each(|(_, n)| *n = jobs);
        }
        Ok(counts)
    }

    /// Jobs that were done and their points, by hours since 1970, from `since` on.
    pub async fn done_by_hour(&self, since: i64) -> Result<Vec<(i64, i64, i64)>> {
        let rows = sqlx::query(
            "SELECT finished_at / 3600000 AS hour, count(*) AS jobs, total(points) AS points \
             FROM job INDEXED BY job_listed WHERE shown IN ('done', 'replaced') AND finished_at >= ? \
             GROUP BY hour ORDER BY hour",
        )
        .bind(since)
        .fetch_all(&self.readers)
        .await?;
        let hour = |row: &sqlx::sqlite::SqliteRow| {
            Ok((row.try_get("hour")?, row.try_get("jobs")?, row.try_get::<f64, _>("points")? as i64))
        };
        rows.iter().map(hour).collect()
    }
}

/// Which jobs; always with a condition, to which others can be added.
fn filter(query: &mut QueryBuilder<Sqlite>, listing: &Listing) {
    match listing.shown {
        Some(shown) => query.push(" WHERE shown = ").push_bind(shown.name()),
        None => query.push(" WHERE shown <> 'dismissed'"),
    };
    if !listing.search.is_empty() {
        let mut pattern = String::from("%");
        for c in listing.search.chars() {
            if matches!(c, '%' | '_' | '\\') {
                pattern.push('\\');
            }
            pattern.push(c);
        }
        pattern.push('%');
        query.push(" AND name LIKE ").push_bind(pattern).push(" ESCAPE '\\'");
    }
}

#[cfg(test)]
#[path = "listing_tests.rs"]
mod tests;
