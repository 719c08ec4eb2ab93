//! Inflow and outflow in the liquid's state, frames and records.

use super::{FlowRecord, FlowTotals, Liquid, LiquidRecord, NAME, outflow::Outflow};
use crate::{
    frame::Stream,
    sim::{SetupError, Timeline},
};

/// Name of the channel of the times at which particles entered.
pub(super) const BIRTH: &str = "birth";

/// Name of the channel of the nozzles' columns.
const NOZZLE: &str = "nozzle";

/// Name of the number that the next particle gets.
const NEXT_ID: &str = "next_id";

/// Flow lengths are below this [m]; the layers of the finest seeding lattice up to there have numbers of 64 bits.
const MAX_LENGTH: f64 = 1e12;

/// Name of the flow length of an emitter.
fn length_name(emitter: usize) -> String {
    format!("emitter_{emitter}_length")
}

impl Liquid {
    /// The state of the flow at the start of a shot, once sources are filled.
    pub(super) fn start_flow(&mut self, timeline: Timeline) {
        self.next_id = self.x.len() as u32;
        self.flow_totals = FlowTotals { initial: self.x.len() as u64, ..FlowTotals::default() };
        self.seeded.thin_outflows = (0..)
            .zip(&self.params.outflow)
            .filter(|(_, outflow)| 2.0 * outflow.shape.inner_radius() < self.params.spacing)
            .map(|(index, _)| index)
            .collect();
        let Some(inflow) = &self.inflow else { return };
        self.nozzle = vec![0; self.x.len()];
        if self.has_births {
            self.birth = vec![0.0; self.x.len()];
        }
        let removes = |x| self.outflow.as_ref().is_some_and(|outflow| outflow.removes(x, 0.0));
        self.seeded.nozzles = inflow.report(&self.walls, removes);
        let displacement = f64::from(self.params.cfl) * f64::from(self.params.spacing);
        self.seeded.allowed_speed = displacement * f64::from(self.params.max_substeps) * timeline.fps;
    }

    /// Restores the state of the flow from a frame's stream.
    pub(super) fn restore_flow(&mut self, stream: &Stream) -> Result<(), SetupError> {
        let missing = |what| SetupError::Missing { stream: NAME, what };
        if self.inflow.is_none() && self.outflow.is_none() {
            return Ok(());
        }
        let mut totals = [0; 4];
        for (value, name) in totals.iter_mut().zip(FlowTotals::NAMES) {
            *value = stream.scalar(name).ok_or(missing(name))? as u64;
        }
        let [initial, emitted, removed, lost] = totals;
        let entered = initial.checked_add(emitted);
        let accounted = (self.x.len() as u64).checked_add(removed).and_then(|sum| sum.checked_add(lost));
        if entered.is_none() || entered != accounted {
            return Err(missing("particle counts that balance"));
        }
        self.flow_totals = FlowTotals::of(totals);
        let Some(inflow) = &mut self.inflow else { return Ok(()) };
        let columns = inflow.column_count();
        let is_valid = |nozzle: &&[u32]| nozzle.iter().all(|&column| column <= columns);
        self.nozzle = stream.u32(NOZZLE).filter(is_valid).ok_or(missing(NOZZLE))?.to_vec();
        if self.has_births {
            self.birth = stream.f32(BIRTH).ok_or(missing(BIRTH))?.to_vec();
        }
        self.next_id = stream.scalar(NEXT_ID).ok_or(missing(NEXT_ID))? as u32;
        if self.id.iter().any(|&id| id >= self.next_id) {
            return Err(missing("next_id above the particles' ids"));
        }
        let length = |emitter| stream.scalar(&length_name(emitter));
        let count = inflow.lengths().count();
        let lengths: Vec<f64> = (0..count).map_while(length).collect();
        if lengths.len() < count || lengths.iter().any(|length| !(0.0..MAX_LENGTH).contains(length)) {
            return Err(missing("emitter_0_length"));
        }
        inflow.set_lengths(&lengths);
        Ok(())
    }

    /// The stream with what [`Liquid::restore_flow`] needs.
    pub(super) fn with_flow(&self, mut stream: Stream) -> Stream {
        if self.inflow.is_none() && self.outflow.is_none() {
            return stream;
        }
        let totals = FlowTotals::NAMES.iter().zip(self.flow_totals.values());
        stream.scalars.extend(totals.map(|(name, value)| ((*name).into(), value as f64)));
        let Some(inflow) = &self.inflow else { return stream };
        stream.scalars.push((NEXT_ID.into(), self.next_id.into()));
        let lengths = inflow.lengths().enumerate();
        stream.scalars.extend(lengths.map(|(emitter, length)| (length_name(emitter), length)));
        stream.with(NOZZLE, self.nozzle.clone())
    }

    /// The empty record of a frame's flow; `None` if nothing enters or leaves.
    pub(super) fn flow_record(&self) -> Option<FlowRecord> {
        if self.inflow.is_none() && self.outflow.is_none() {
            return None;
        }
        let emitters = vec![0; self.inflow.as_ref().map_or(0, |inflow| inflow.lengths().count())];
        Some(FlowRecord {
            blocked_by_solids: emitters.clone(),
            blocked_by_liquid: emitters.clone(),
            emitted: emitters,
            removed: vec![0; self.outflow.as_ref().map_or(0, Outflow::volume_count)],
            ..FlowRecord::default()
        })
    }

    /// Ends the record of a frame's flow.
    ///
    /// # Panics
    /// If particles are lost: a fault of the program.
    pub(super) fn record_flow(&mut self, record: &mut LiquidRecord) {
        let Some(flow) = &mut record.flow else { return };
        let totals = &mut self.flow_totals;
        totals.emitted += flow.emitted.iter().sum::<u64>();
        totals.removed += flow.removed.iter().chain(&flow.left_by_side).sum::<u64>();
        totals.left_by_accident += flow.left_by_accident;
        (flow.totals, flow.present) = (*totals, self.x.len() as u64);
        let left = totals.removed + totals.left_by_accident;
        assert_eq!(totals.initial + totals.emitted, flow.present + left, "the balance of particles");
    }
}
