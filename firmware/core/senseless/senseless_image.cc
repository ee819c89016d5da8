#include "firmware/core/senseless/senseless_image.h"

#include <algorithm>

namespace armtrue::tests {
namespace {

using format::Section;
using format::State;

constexpr std::int64_t kReach = std::int64_t{12} << Length::fraction;
constexpr std::size_t kRoom = 14000;  // bytes that sections may take together

}  // namespace

void SenselessImage::make() {
  is_disorderly_ = once_in(4);
  is_full_pose_ = once_in(2);
  joints_ = once_in(2) ? kMaxJoints : 1 + below(kMaxJoints);
  prismatic_ = once_in(2) ? 0U : static_cast<std::uint32_t>(random_());
  std::int64_t reach = kReach;
  for (std::size_t k = 0; k < joints_; ++k) append_joint(reach);
  const std::size_t tools = 1 + below(kMaxTools);
  for (std::size_t i = 0; i < tools; ++i) {
    std::int64_t left = reach;
    append_transform(section(Section::kTools), left);
    section(Section::kTools).resize((i + 1) * format::tool::kLength, 'T');
  }
  make_coupling();
  sensors_ = amount(kMaxSensors);
  for (std::size_t s = 0; s < sensors_; ++s) {
    append(section(Section::kSensors), as<std::int32_t>(-299999, 999999));
    section(Section::kSensors).resize((s + 1) * format::sensor::kLength);
  }
  make_masses();
  make_states();
  make_nodes();
  make_terms();
  assemble();
}

void SenselessImage::append_transform(Bytes& to, std::int64_t& reach) {
  // Rows of unit length; the reader does not check that they are orthogonal.
  constexpr std::int32_t kUnit = std::int32_t{1} << 30;
  constexpr std::int32_t kShort = 644245094;  // 0.6
  constexpr std::int32_t kLong = 858993459;   // 0.8
  for (int row = 0; row < 3; ++row) {
    std::array<std::int32_t, 3> elements = {kUnit, 0, 0};
    if (once_in(2)) elements = {kLong, kShort, 0};
    std::rotate(elements.begin(), elements.begin() + static_cast<std::ptrdiff_t>(below(3)),
                elements.end());
    for (const std::int32_t element : elements) append(to, once_in(2) ? element : -element);
  }
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t most = once_in(4) ? reach : reach / 20;
    const std::int64_t length = within(0, most);
    reach -= std::min(length, reach);
    append(to, static_cast<std::int32_t>(once_in(2) ? length : -length));
  }
}

void SenselessImage::append_scale(Bytes& to) {
  const std::int32_t sign = once_in(2) ? 1 : -1;
  const auto power = static_cast<int>(within(4, 31));  // 2^power increments a unit
  std::int32_t u = std::int32_t{1} << 30;
  std::int32_t v = u;
  if (power < 31 && once_in(2)) {  // not a power of two
    v += static_cast<std::int32_t>(below(std::uint64_t{1} << 29U));
    u = static_cast<std::int32_t>((std::int64_t{1} << 60) / v);
  }
  append(to, sign * u);
  append(to, sign * v);
  append(to, static_cast<std::uint8_t>(power - 2));
  append(to, static_cast<std::uint8_t>(62 - power));
}

void SenselessImage::append_joint(std::int64_t& reach) {
  Bytes& to = section(Section::kJoints);
  const std::size_t k = to.size() / format::joint::kLength;
  append_transform(to, reach);
  append(to, within(-(std::int64_t{8} << 32), std::int64_t{8} << 32));
  append(to, extreme());  // zero
  append_scale(to);
  append(to, static_cast<std::uint8_t>(prismatic_ >> k & 1U));
  append(to, static_cast<std::uint8_t>(passive_ >> k & 1U ? format::joint::kPassive : 0U));
  constexpr std::int64_t kMost = std::numeric_limits<std::int32_t>::max();
  append(to, once_in(2) ? kMaxDeltaRevolute : as<std::int32_t>(0, kMost));
  append(to, once_in(2) ? kMaxRateRevolute : as<std::int32_t>(kMinRate, kMost));
  append(to, as<std::int32_t>(0, kMost));  // dead band
}

void SenselessImage::make_coupling() {
  std::vector<std::size_t> turning;
  for (std::size_t k = 0; k < joints_; ++k) {
    if ((prismatic_ >> k & 1U) == 0U) turning.push_back(k);
  }
  for (const std::size_t column : turning) {
    if ((passive_ >> column & 1U) != 0U) continue;
    std::int64_t room = std::int64_t{8} << format::coupling::kRatioFraction;
    for (const std::size_t row : turning) {
      if (row == column || !once_in(6)) continue;
      constexpr std::int64_t kMost = std::numeric_limits<std::int32_t>::max();
      const std::int64_t size = within(0, std::min(room, kMost));
      room -= std::min(room, size);
      Bytes& to = section(Section::kCoupling);
      append(to, static_cast<std::uint8_t>(row));
      append(to, static_cast<std::uint8_t>(column));
      append(to, std::uint16_t{0});
      append(to, static_cast<std::int32_t>(once_in(2) ? size : -size));
    }
  }
}

void SenselessImage::make_masses() {
  mass_sets_ = amount(once_in(3) ? kMaxMassSets : 3);
  for (std::size_t i = 0; i < mass_sets_; ++i) {
    Bytes& to = section(Section::kMassSets);
    const bool carries = once_in(2);
    const int fraction = static_cast<int>(within(0, carries ? 30 : 60));
    set_fractions_.push_back(fraction);
    append(to, static_cast<std::uint8_t>(fraction));
    append(to, static_cast<std::uint8_t>(carries));
    append(to, std::uint16_t{0});
    for (std::size_t word = 0; word < 4 * joints_; ++word) append(to, extreme());
  }
  if (mass_sets_ == 0 && once_in(2)) return;
  Bytes& to = section(Section::kGravity);
  for (int axis = 0; axis < 3; ++axis) append(to, extreme());
  for (int axis = 0; axis < 3; ++axis) {
    append(to, as<std::int32_t>(-(std::int64_t{4} << 27), std::int64_t{4} << 27));
  }
  append(to, as<std::int32_t>(0, std::numeric_limits<std::int32_t>::max()));
}

void SenselessImage::add_state(State kind, std::uint8_t index, std::uint8_t set, int fraction) {
  Bytes& to = section(Section::kState);
  append(to, static_cast<std::uint8_t>(kind));
  append(to, index);
  append(to, set);
  append(to, static_cast<std::int8_t>(fraction));
  ++states_;
}

void SenselessImage::make_states() {
  const auto joint = [this] { return as<std::uint8_t>(0, static_cast<std::int64_t>(joints_) - 1); };
  add_state(State::kOne, 0, 0, 30);
  for (std::size_t i = amount(40); i > 0; --i) {
    switch (below(4)) {
      case 0:
        add_state(State::kDirection, joint(), 0, format::kDirectionFraction);
        break;
      case 1:
        add_state(State::kPayload, 0, 0, format::kPayloadFraction);
        break;
      case 2:
        add_state(State::kTime, 0, 0, format::kTimeFraction);
        break;
      default:
        if (sensors_ == 0) break;
        add_state(State::kTemperature, as<std::uint8_t>(0, static_cast<std::int64_t>(sensors_) - 1),
                  0, format::kTemperatureFraction);
    }
  }
  still_states_ = states_;
  for (std::size_t i = amount(60); i > 0; --i) {
    const State kind = once_in(2) ? State::kMotor : State::kLink;  // argument order is unspecified
    add_state(kind, joint(), 0, format::kPositionFraction);
  }
  constexpr State kKinds[] = {State::kTorque, State::kMomentX, State::kMomentY, State::kBaseMomentX,
                              State::kBaseMomentY};
  for (std::size_t i = mass_sets_ == 0 ? 0 : amount(40); i > 0; --i) {
    const State kind = kKinds[below(5)];
    const bool is_base = kind == State::kBaseMomentX || kind == State::kBaseMomentY;
    const std::size_t set = below(mass_sets_);
    add_state(kind, is_base ? std::uint8_t{0} : joint(), static_cast<std::uint8_t>(set),
              set_fractions_[set]);
  }
}

// A slot that the next node of `part`, or a record that may read all slots below `end`, may name.
std::uint16_t SenselessImage::slot(std::size_t part, std::size_t end) {
  if (part == kConstant) {
    const std::size_t nodes = end > states_ ? end - states_ : 0;
    const std::size_t chosen = below(still_states_ + nodes);
    return static_cast<std::uint16_t>(chosen < still_states_ ? chosen
                                                             : states_ + chosen - still_states_);
  }
  return static_cast<std::uint16_t>(once_in(3) ? end - 1U : below(end));
}

std::optional<std::uint16_t> SenselessImage::angle_source(std::size_t part) {
  const std::size_t joint = below(joints_);
  if (part == kConstant || (prismatic_ >> joint & 1U) != 0U) return std::nullopt;
  return static_cast<std::uint16_t>(joint | (once_in(2) ? 0U : format::node::kLinkAngle));
}

std::int32_t SenselessImage::make_spline(std::uint8_t& cells) {
  Bytes& data = section(Section::kData);
  const auto word = static_cast<std::int32_t>(data.size() / 4);
  cells = static_cast<std::uint8_t>(once_in(8) ? 20 : 1 + below(3));
  for (int i = 0; i < 4 * cells; ++i) append(data, extreme());
  return word;
}

void SenselessImage::append_axis(Bytes& to, std::size_t nodes, std::uint16_t slot) {
  const bool is_listed = once_in(2);
  append(to, slot);
  append(to, static_cast<std::uint16_t>(nodes));
  append(to, static_cast<std::uint8_t>(below(4) << 1U | (is_listed ? 1U : 0U)));
  append(to, std::uint8_t{0});
  append(to, std::uint16_t{0});
  if (!is_listed) {
    append(to, extreme());
    append(to, static_cast<std::uint32_t>(within(1, 0xFFFFFFFF)));
    return;
  }
  // Nodes over the whole 32-bit range, or one unit apart at a random place.
  const std::int64_t step =
      once_in(2) ? 1 : (std::int64_t{1} << 32) / static_cast<std::int64_t>(nodes);
  const std::int64_t most =
      (std::int64_t{1} << 31) - 1 - step * static_cast<std::int64_t>(nodes - 1);
  const std::int64_t first = within(-(std::int64_t{1} << 31), most);
  for (std::size_t i = 0; i < nodes; ++i) {
    append(to, static_cast<std::int32_t>(first + step * static_cast<std::int64_t>(i)));
  }
  for (std::size_t i = 1; i < nodes; ++i) {
    append(to, static_cast<std::uint32_t>(within(1, 0xFFFFFFFF)));
  }
}

std::int32_t SenselessImage::make_grid(std::size_t part, std::uint8_t& outputs) {
  const std::size_t axes = 1 + below(kMaxGridAxes);
  outputs = static_cast<std::uint8_t>(1 + (once_in(2) ? 0 : below(8)));
  Bytes grid = {static_cast<std::uint8_t>(axes), outputs, 0, 0};
  std::size_t nodes = 1;
  for (std::size_t a = 0; a < axes; ++a) {
    const std::size_t own = 2 + (once_in(3) && nodes < 40 ? below(30 / axes) : 0);
    nodes *= own;
    append_axis(grid, own, slot(part, states_ + nodes_));
  }
  std::vector<bool> covered(nodes);
  for (std::size_t n = 0; n < nodes; ++n) covered[n] = !once_in(5);
  for (std::size_t word = 0; word < (nodes + 31) / 32; ++word) {
    std::uint32_t mask = 0;
    for (std::size_t bit = 0; bit < 32 && 32 * word + bit < nodes; ++bit) {
      mask |= covered[32 * word + bit] ? 1U << bit : 0U;
    }
    append(grid, mask);
  }
  for (std::size_t n = 0; n < nodes * outputs; ++n) {
    const auto value = static_cast<std::int16_t>(extreme() >> (once_in(2) ? 16 : 0));
    append(grid, covered[n / outputs] ? value : std::int16_t{0});
  }
  grid.resize((grid.size() + 3) / 4 * 4);
  Bytes& data = section(Section::kData);
  const auto word = static_cast<std::int32_t>(data.size() / 4);
  data.insert(data.end(), grid.begin(), grid.end());
  return word;
}

void SenselessImage::append_node(std::size_t part) {
  using format::Node;
  const std::size_t end = states_ + nodes_;
  const auto kind = static_cast<Node>(1 + below(format::kNodeKinds - 1));
  std::uint8_t shift = 0;
  std::uint8_t shift2 = 0;
  std::uint8_t count = 0;
  std::uint16_t a = 0;
  std::uint16_t b = 0;
  std::int32_t p = 0;
  std::int32_t r = 0;
  if (kind != Node::kGrid) a = slot(part, end);
  switch (kind) {
    case Node::kHarmonic:
    case Node::kAngle: {
      const std::optional<std::uint16_t> source = angle_source(part);
      if (!source) return;
      a = *source;
      if (kind == Node::kAngle) b = once_in(2) ? format::node::kNone : slot(part, end);
      p = extreme();
      r = extreme();
      break;
    }
    case Node::kToAngle:
    case Node::kScale:
      shift = as<std::uint8_t>(kind == Node::kToAngle ? 1 : 0, 62);
      p = extreme();
      r = extreme();
      break;
    case Node::kSine:
      r = extreme();
      break;
    case Node::kSum:
      shift = as<std::uint8_t>(-31, 31);
      shift2 = as<std::uint8_t>(-31, 31);
      b = slot(part, end);
      break;
    case Node::kProduct:
    case Node::kMinimum:
    case Node::kMaximum:
      b = slot(part, end);
      break;
    case Node::kReciprocal:
      shift = as<std::uint8_t>(0, 62);
      break;
    case Node::kPowerOfTwo:
      shift = as<std::uint8_t>(0, 30);
      p = as<std::int32_t>(-60, 60);
      break;
    case Node::kSpline:
      shift = as<std::uint8_t>(0, 30);
      p = extreme();
      r = make_spline(count);
      break;
    case Node::kGrid:
      r = make_grid(part, count);
      break;
    default:
      break;
  }
  Bytes& to = section(Section::kNodes);
  to.insert(to.end(), {static_cast<std::uint8_t>(kind), shift, shift2, count});
  append(to, a);
  append(to, b);
  append(to, p);
  append(to, r);
  ++nodes_;
  for (; kind == Node::kGrid && count > 1; --count) {
    to.resize(to.size() + format::node::kLength);
    ++nodes_;
  }
}

void SenselessImage::make_nodes() {
  for (const std::size_t part : {kConstant, kSteep, kSmooth}) {
    for (std::size_t i = amount(50); i > 0 && states_ + nodes_ < kMaxSlots - 8; --i) {
      if (section(Section::kData).size() < kRoom / 2) append_node(part);
    }
    node_ends_[part] = nodes_;
  }
}

std::uint8_t SenselessImage::coordinate(bool motor) {
  if (motor || once_in(3)) {
    const auto joint = as<std::uint8_t>(0, static_cast<std::int64_t>(joints_) - 1);
    // A disorderly image may name a joint up to 255. Which bit is read for a joint that does not
    // exist does not matter, but a shift by more than 63 is undefined.
    const bool is_passive = (passive_ >> (joint % 64U) & 1U) != 0U;
    return motor && is_passive ? std::uint8_t{0} : joint;
  }
  const std::size_t frame = once_in(5) ? format::kToolFrame : below(joints_ + 1);
  return static_cast<std::uint8_t>(format::kMotorCoordinates + 6 * frame + below(6));
}

void SenselessImage::make_terms() {
  std::size_t terms = 0;
  for (const std::size_t part : {kConstant, kSteep, kSmooth}) {
    const std::size_t end =
        states_ + (part == kSteep ? node_ends_[kSteep]
                                  : (part == kConstant ? node_ends_[kConstant] : nodes_));
    for (std::size_t i = amount(100); i > 0; --i, ++terms) {
      Bytes& to = section(Section::kTerms);
      append(to, coordinate(part == kSteep));
      append(to, std::uint8_t{0});
      append(to, slot(part, end));
      append(to, extreme());
    }
    term_ends_[part] = terms;
  }
  const std::size_t harmonics = amount(120);
  steep_harmonics_ = harmonics == 0 ? 0 : below(harmonics + 1);
  std::size_t made = 0;
  for (std::size_t i = 0; i < harmonics; ++i) {
    const bool is_steep = i < steep_harmonics_;
    const std::optional<std::uint16_t> source = angle_source(kSmooth);
    if (!source) {
      steep_harmonics_ -= is_steep ? 1U : 0U;
      continue;
    }
    Bytes& to = section(Section::kHarmonics);
    append(to, coordinate(made < steep_harmonics_ || is_steep));
    append(to, std::uint8_t{0});
    append(to, *source);
    for (int word = 0; word < 3; ++word) append(to, extreme());
    ++made;
  }
  steep_harmonics_ = std::min(steep_harmonics_, made);
  for (std::size_t i = amount(kMaxSlowWaves); i > 0; --i) {
    const auto source = angle_source(kSmooth);
    if (!source) continue;
    Bytes& to = section(Section::kSlowWaves);
    append(to, coordinate(false));
    append(to, static_cast<std::uint8_t>(*source & 0xFFU));
    append(to, std::uint16_t{0});
    for (int word = 0; word < 4; ++word) {
      append(to, as<std::int32_t>(-(std::int64_t{1} << 29), std::int64_t{1} << 29));
    }
  }
}

void SenselessImage::assemble() {
  namespace header = format::header;
  std::erase_if(sections_, [](const auto& entry) { return entry.second.empty(); });
  Bytes bytes(header::kLength);
  put(bytes, header::kMagicAt, format::kMagic);
  put(bytes, header::kVersionAt, format::kVersion);
  put(bytes, header::kHeaderLengthAt, static_cast<std::uint16_t>(header::kLength));
  bytes[header::kJointCountAt] = static_cast<std::uint8_t>(joints_);
  bytes[header::kSensorCountAt] = static_cast<std::uint8_t>(sensors_);
  const std::size_t tools = section(Section::kTools).size() / format::tool::kLength;
  bytes[header::kToolCountAt] = static_cast<std::uint8_t>(tools);
  bytes[header::kActiveToolAt] = as<std::uint8_t>(0, static_cast<std::int64_t>(tools) - 1);
  put(bytes, header::kBlendAt, as<std::uint16_t>(0, 0xFFFF));
  put(bytes, header::kDampingAt, as<std::int32_t>(1 << 19, 1 << 27));
  if (is_full_pose_) {
    bytes[header::kFlagsAt] = format::kFlagFullPose;
    put(bytes, header::kRotationLengthAt, as<std::int32_t>(1 << 22, 1 << 28));
  }
  put(bytes, header::kConstantNodesAt, static_cast<std::uint16_t>(node_ends_[kConstant]));
  put(bytes, header::kSteepNodesAt, static_cast<std::uint16_t>(node_ends_[kSteep]));
  put(bytes, header::kConstantTermsAt, static_cast<std::uint16_t>(term_ends_[kConstant]));
  put(bytes, header::kSteepTermsAt, static_cast<std::uint16_t>(term_ends_[kSteep]));
  put(bytes, header::kSteepHarmonicsAt, static_cast<std::uint16_t>(steep_harmonics_));
  bytes[header::kSectionCountAt] = static_cast<std::uint8_t>(sections_.size());
  std::size_t offset = header::kLength + sections_.size() * format::kDirectoryEntryLength;
  for (const auto& [kind, content] : sections_) {
    append(bytes, kind);
    append(bytes, static_cast<std::uint16_t>(content.size() /
                                             record_length(static_cast<Section>(kind), joints_)));
    append(bytes, static_cast<std::uint32_t>(offset));
    offset += content.size();
  }
  for (const auto& [kind, content] : sections_) {
    bytes.insert(bytes.end(), content.begin(), content.end());
  }
  put(bytes, header::kImageLengthAt, static_cast<std::uint32_t>(bytes.size() + 4));
  append(bytes, crc32(bytes));
  image_ = std::move(bytes);
}

}  // namespace armtrue::tests
