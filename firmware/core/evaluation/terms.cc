#include "firmware/core/evaluation/terms.h"

#include "firmware/core/evaluation/grid.h"

namespace armtrue {
namespace {

// x / 2^shift rounded, or x · 2^-shift for a negative shift; saturated.
std::int32_t scaled(std::int64_t x, int shift) {
  if (shift > 0) return saturate(round_shift(x, shift));
  return saturate(x * (std::int64_t{1} << -shift));
}

// Converts a joint position to its state variable, radian or metre, Q28. Saturates at ±7.9, the
// exporter's limit.
std::int32_t state_position(const TableView& table, std::size_t k, JointPosition position,
                            TermFlags& flags) {
  constexpr std::int32_t kTwoPi = 1686629713;        // 2 π · 2^28
  constexpr std::int64_t kMostTurns = 5400113600;    // 7.9 / 2 π · 2^32
  constexpr std::int64_t kMostMetres = 33930241638;  // 7.9 · 2^32
  const bool slides = table.is_prismatic(k);
  const std::int64_t most = slides ? kMostMetres : kMostTurns;
  std::int64_t raw = position.raw;
  if (raw > most || raw < -most) {
    flags.is_saturated = true;
    raw = raw < 0 ? -most : most;
  }
  return slides ? rounded<4>(raw) : multiply<30>(static_cast<std::int32_t>(raw >> 2), kTwoPi);
}

const JointPosition& angle_source(std::uint16_t source, const JointPositions& motor,
                                  const JointPositions& link) {
  return source >= format::node::kLinkAngle ? link[source - format::node::kLinkAngle]
                                            : motor[source];
}

// order · position within the turn: the low 64 bits of the product hold all that is needed.
std::uint32_t multiple(JointPosition position, std::int32_t order) {
  const std::uint64_t wide = static_cast<std::uint64_t>(position.raw) *
                             static_cast<std::uint64_t>(static_cast<std::int64_t>(order));
  return static_cast<std::uint32_t>(wide >> static_cast<unsigned>(format::node::kOrderFraction));
}

// 2^shift / x, saturated; for x = 0 the largest value. shift in 0 … 62.
std::int32_t reciprocal_of(std::int32_t x, int shift, TermFlags& flags) {
  if (x == 0) {
    flags.is_saturated = true;
    return std::numeric_limits<std::int32_t>::max();
  }
  const std::uint32_t size =
      x < 0 ? 0U - static_cast<std::uint32_t>(x) : static_cast<std::uint32_t>(x);
  const Reciprocal r = reciprocal(size);
  // 2^shift / size = mantissa · 2^(shift + exponent - 62), at most 31 + shift - 31 bits.
  const int down = 62 - shift - r.exponent;
  std::int64_t value = 0;
  if (down > 0) {
    value = down < 40 ? round_shift(r.mantissa, down) : 0;
  } else {
    value = static_cast<std::int64_t>(r.mantissa) << -down;
  }
  const std::int32_t result = saturate(x < 0 ? -value : value);
  flags.is_saturated = flags.is_saturated || value > std::numeric_limits<std::int32_t>::max();
  return result;
}

// Piecewise cubic; held constant beyond its ends.
std::int32_t spline(const std::uint8_t* data, std::int32_t first, int cell_shift,
                    std::uint32_t cells, std::int32_t value, TermFlags& flags) {
  std::int64_t distance = static_cast<std::int64_t>(value) - first;
  const std::int64_t end = (static_cast<std::int64_t>(cells) << cell_shift) - 1;
  if (distance < 0 || distance > end) {
    flags.is_outside_coverage = true;
    distance = distance < 0 ? 0 : end;
  }
  const auto cell = static_cast<std::uint32_t>(distance >> cell_shift);
  const std::int64_t rest = distance - (static_cast<std::int64_t>(cell) << cell_shift);
  const auto within = static_cast<std::int32_t>(rest << (31 - cell_shift));  // Q31
  const std::uint8_t* coefficient = data + cell * format::kSplineCellLength;
  std::int64_t sum = load_i32(coefficient + 12);
  for (int power = 2; power >= 0; --power) {
    sum = round_shift(product(saturate(sum), within), 31) + load_i32(coefficient + 4 * power);
  }
  return saturate(sum);
}

// 2^x on 0 ≤ x ≤ 1, Q30: minimax polynomial (Remez), error 2.7e-9 before rounding.
constexpr std::array<std::int32_t, 7> kPowerPolynomial = {
    1073741827, 744260843, 257945589, 59571434, 10399164, 1329754, 235034};

// 2^(x / 2^shift) with `fraction` bits; saturates.
std::int32_t power_of_two(std::int32_t x, int shift, int fraction, TermFlags& flags) {
  const std::int32_t whole = x >> shift;  // rounds down
  const std::int64_t rest =
      static_cast<std::int64_t>(x) - (static_cast<std::int64_t>(whole) << shift);
  const auto within = static_cast<std::int32_t>(rest << (30 - shift));  // 0 … 1, Q30
  std::int32_t sum = kPowerPolynomial.back();
  for (std::size_t i = kPowerPolynomial.size() - 1; i-- > 0;) {
    sum = multiply<30>(sum, within) + kPowerPolynomial[i];
  }
  const std::int64_t up = static_cast<std::int64_t>(whole) + fraction - 30;
  if (up > 0) {  // the sum is at least 2^30
    flags.is_saturated = true;
    return std::numeric_limits<std::int32_t>::max();
  }
  if (up == 0) return sum;
  return up < -40 ? 0 : static_cast<std::int32_t>(round_shift(sum, static_cast<int>(-up)));
}

struct NodeContext {
  const TableView& table;
  const JointPositions& motor;
  const JointPositions& link;
};

void evaluate_nodes(const NodeContext& context, std::size_t begin, std::size_t end,
                    TermWorkspace& work) {
  const std::size_t first_slot = context.table.section(format::Section::kState).count;
  const std::uint8_t* nodes = context.table.section(format::Section::kNodes).begin;
  const std::uint8_t* data = context.table.section(format::Section::kData).begin;
  std::int32_t* slots = work.slots.data();
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint8_t* node = nodes + i * format::node::kLength;
    const auto a = [node] { return load_u16(node + format::node::kAAt); };
    const auto b = [node] { return load_u16(node + format::node::kBAt); };
    const auto p = [node] { return load_i32(node + format::node::kPAt); };
    const auto r = [node] { return load_i32(node + format::node::kRAt); };
    const auto shift = [node] { return static_cast<int>(load_i8(node + format::node::kShiftAt)); };
    const auto shift2 = [node] {
      return static_cast<int>(load_i8(node + format::node::kShift2At));
    };
    std::int32_t& out = slots[first_slot + i];
    switch (static_cast<format::Node>(node[format::node::kKindAt])) {
      case format::Node::kContinuation:
        break;
      case format::Node::kHarmonic:
        out = sine({multiple(angle_source(a(), context.motor, context.link), p()) +
                    static_cast<std::uint32_t>(r())})
                  .raw;
        break;
      case format::Node::kAngle: {
        const std::uint32_t onto =
            b() == format::node::kNone ? 0U : static_cast<std::uint32_t>(slots[b()]);
        out = static_cast<std::int32_t>(
            multiple(angle_source(a(), context.motor, context.link), p()) +
            static_cast<std::uint32_t>(r()) + onto);
        break;
      }
      case format::Node::kToAngle:
        out = static_cast<std::int32_t>(static_cast<std::uint32_t>(static_cast<std::uint64_t>(
                                            round_shift(product(slots[a()], p()), shift()))) +
                                        static_cast<std::uint32_t>(r()));
        break;
      case format::Node::kSine:
        out = sine({static_cast<std::uint32_t>(slots[a()]) + static_cast<std::uint32_t>(r())}).raw;
        break;
      case format::Node::kProduct:
        out = round_high(slots[a()], slots[b()]);
        break;
      case format::Node::kSum:
        out = saturate(static_cast<std::int64_t>(scaled(slots[a()], shift())) +
                       scaled(slots[b()], shift2()));
        break;
      case format::Node::kScale:
        out = saturate(static_cast<std::int64_t>(scaled(product(slots[a()], p()), shift())) + r());
        break;
      case format::Node::kReciprocal:
        out = reciprocal_of(slots[a()], shift(), work.flags);
        break;
      case format::Node::kAbsolute:
        out = slots[a()] < 0 ? saturate(-static_cast<std::int64_t>(slots[a()])) : slots[a()];
        break;
      case format::Node::kSign:
        out = (slots[a()] > 0 ? kRatioOne.raw : 0) - (slots[a()] < 0 ? kRatioOne.raw : 0);
        break;
      case format::Node::kMinimum:
        out = slots[a()] < slots[b()] ? slots[a()] : slots[b()];
        break;
      case format::Node::kMaximum:
        out = slots[a()] > slots[b()] ? slots[a()] : slots[b()];
        break;
      case format::Node::kSpline:
        out = spline(data + 4 * static_cast<std::size_t>(r()), p(), shift(),
                     node[format::node::kCountAt], slots[a()], work.flags);
        break;
      case format::Node::kPowerOfTwo:
        out = power_of_two(slots[a()], shift(), p(), work.flags);
        break;
      case format::Node::kGrid:
        if (!interpolate(data + 4 * static_cast<std::size_t>(r()), slots, &out)) {
          work.flags.is_outside_coverage = true;
        }
        break;
    }
  }
}

// Adds to a coordinate and notes where it saturates.
void add_to(Coordinate& sum, std::int32_t value, TermFlags& flags) {
  if (armtrue::add_to(sum, value)) {
    flags.is_saturated = true;
  }
}

void add_terms(const TableView& table, std::size_t begin, std::size_t end, TermWorkspace& work,
               Coordinate* coordinates) {
  const std::uint8_t* terms = table.section(format::Section::kTerms).begin;
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint8_t* term = terms + i * format::term::kLength;
    const std::int32_t slot = work.slots[load_u16(term + format::term::kSlotAt)];
    add_to(coordinates[term[format::term::kCoordinateAt]],
           round_high(load_i32(term + format::term::kMantissaAt), slot), work.flags);
  }
}

void add_harmonics(const NodeContext& context, std::size_t begin, std::size_t end, TermFlags& flags,
                   Coordinate* coordinates) {
  const std::uint8_t* harmonics = context.table.section(format::Section::kHarmonics).begin;
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint8_t* at = harmonics + i * format::harmonic::kLength;
    const BinaryAngle angle = {multiple(angle_source(load_u16(at + format::harmonic::kSourceAt),
                                                     context.motor, context.link),
                                        load_i32(at + format::harmonic::kOrderAt)) +
                               load_u32(at + format::harmonic::kPhaseAt)};
    add_to(coordinates[at[format::harmonic::kCoordinateAt]],
           round_high(load_i32(at + format::harmonic::kAmplitudeAt), sine(angle).raw), flags);
  }
}

void add_slow_waves(const TableView& table, const JointMotions& motions, TermFlags& flags,
                    Coordinate* coordinates) {
  const SectionView& waves = table.section(format::Section::kSlowWaves);
  for (std::size_t i = 0; i < waves.count; ++i) {
    const std::uint8_t* at = waves.begin + i * format::slow_wave::kLength;
    const JointMotion& joint = motions[at[format::slow_wave::kJointAt]];
    // sin 2θ = 2 sin θ cos θ, cos 2θ = 1 - 2 sin² θ.
    const std::int32_t sine2 = multiply<Ratio::fraction - 1>(joint.sine, joint.cosine);
    const std::int32_t cosine2 =
        wrapping_difference(kRatioOne.raw, multiply<Ratio::fraction - 1>(joint.sine, joint.sine));
    const std::int64_t wide = product(load_i32(at + format::slow_wave::kSineAt), joint.sine) +
                              product(load_i32(at + format::slow_wave::kCosineAt), joint.cosine) +
                              product(load_i32(at + format::slow_wave::kSine2At), sine2) +
                              product(load_i32(at + format::slow_wave::kCosine2At), cosine2);
    add_to(coordinates[at[format::slow_wave::kCoordinateAt]],
           static_cast<std::int32_t>(round_shift(wide, 32)), flags);
  }
}

}  // namespace

std::int32_t temperature_difference(std::int32_t milli_degc, std::int32_t reference_milli_degc) {
  // 2^20 / 1000 = 1048.576, times 2^20.
  constexpr std::int32_t kPerMilli = 1099511628;
  const std::int32_t difference =
      saturate(static_cast<std::int64_t>(milli_degc) - reference_milli_degc);
  return saturate(round_shift(product(difference, kPerMilli), 20));
}

std::int32_t payload_of_grams(std::int32_t gram) {
  return temperature_difference(gram, 0);  // thousandths to 2^-20 as well
}

std::int32_t time_of_milliseconds(std::uint64_t millisecond) {
  // 2^10 / 1000 = 1.024, times 2^30.
  constexpr std::uint64_t kPerMilli = 1099511628;
  // Larger values saturate in any case; the bound keeps the product from overflowing.
  constexpr std::uint64_t kMost = std::uint64_t{1} << 32U;
  const std::uint64_t bounded = millisecond < kMost ? millisecond : kMost;
  return saturate(
      static_cast<std::int64_t>((bounded * kPerMilli + (std::uint64_t{1} << 29U)) >> 30U));
}

void begin_terms(const TableView& table, const Surroundings& surroundings, TermWorkspace& work) {
  work.flags = {};
  work.payload = surroundings.payload;
  const SectionView& gravity = table.section(format::Section::kGravity);
  if (gravity.count != 0U) {
    const std::int32_t limit = load_i32(gravity.begin + format::gravity::kPayloadLimitAt);
    if (work.payload > limit || work.payload < 0) {
      work.flags.is_saturated = true;
      work.payload = work.payload < 0 ? 0 : limit;
    }
  }
  work.constant = table.constants();
  const SectionView& state = table.section(format::Section::kState);
  for (std::size_t i = 0; i < table.first_position_state(); ++i) {
    const std::uint8_t* variable = state.begin + i * format::state::kLength;
    const std::size_t index = variable[format::state::kIndexAt];
    switch (static_cast<format::State>(variable[format::state::kKindAt])) {
      case format::State::kOne:
        work.slots[i] = kRatioOne.raw;
        break;
      case format::State::kTemperature:
        work.slots[i] = surroundings.temperature_difference[index];
        break;
      case format::State::kPayload:
        work.slots[i] = work.payload;
        break;
      case format::State::kDirection:
        work.slots[i] = surroundings.direction[index] * kRatioOne.raw;
        break;
      case format::State::kTime:
        work.slots[i] = surroundings.time;
        break;
      default:
        work.slots[i] = 0;
        break;
    }
  }
  // Constant nodes never read joint positions.
  const JointPositions& unread = work.no_positions;
  evaluate_nodes({table, unread, unread}, 0, table.constant_counts().nodes, work);
  add_terms(table, table.first_changing_term(), table.constant_counts().terms, work,
            work.constant.data());
}

void evaluate_steep_terms(const TableView& table, const JointPositions& motor,
                          const JointPositions& link, TermWorkspace& work,
                          MotorCoordinates& steep) {
  const SectionView& state = table.section(format::Section::kState);
  for (std::size_t i = table.first_position_state(); i < table.first_gravity_state(); ++i) {
    const std::uint8_t* variable = state.begin + i * format::state::kLength;
    const std::size_t k = variable[format::state::kIndexAt];
    const bool is_motor =
        static_cast<format::State>(variable[format::state::kKindAt]) == format::State::kMotor;
    work.slots[i] = state_position(table, k, is_motor ? motor[k] : link[k], work.flags);
  }
  for (Coordinate& sum : steep) {
    sum.raw = 0;
  }
  const NodeContext context = {table, motor, link};
  const TermCounts& steep_counts = table.steep_counts();
  evaluate_nodes(context, table.constant_counts().nodes, steep_counts.nodes, work);
  add_terms(table, table.constant_counts().terms, steep_counts.terms, work, steep.data());
  add_harmonics(context, 0, steep_counts.harmonics, work.flags, steep.data());
}

void evaluate_smooth_terms(const TableView& table, const JointPositions& motor,
                           const JointPositions& link, const JointMotions& motions,
                           TermWorkspace& work, Coordinates& coordinates) {
  for (std::size_t k = 0; k < table.joint_count(); ++k) {
    coordinates[k] = work.constant[k];
  }
  const std::size_t end = format::kMotorCoordinates + 6 * (table.joint_count() + 1U);
  for (std::size_t c = format::kMotorCoordinates; c < end; ++c) {
    coordinates[c] = work.constant[c];
  }
  if (table.has_motion(format::kToolFrame)) {
    for (std::size_t c = format::kToolCoordinates; c < format::kCoordinates; ++c) {
      coordinates[c] = work.constant[c];
    }
  }
  const NodeContext context = {table, motor, link};
  const TermCounts& steep = table.steep_counts();
  evaluate_nodes(context, steep.nodes, table.section(format::Section::kNodes).count, work);
  add_terms(table, steep.terms, table.section(format::Section::kTerms).count, work,
            coordinates.data());
  add_harmonics(context, steep.harmonics, table.section(format::Section::kHarmonics).count,
                work.flags, coordinates.data());
  add_slow_waves(table, motions, work.flags, coordinates.data());
}

}  // namespace armtrue
