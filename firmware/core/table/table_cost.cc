#include "firmware/core/table/table_cost.h"

#include <array>
#include <bit>

#include "firmware/core/fixed/bytes.h"
#include "firmware/core/table/format.h"
#include "firmware/core/table/limits.h"
#include "firmware/core/table/table_view.h"

namespace armtrue {
namespace {

using format::Section;

// Evaluations of the parts of the term list in a cycle (inverse.h).
constexpr std::uint32_t kConstantPasses = 1;
constexpr std::uint32_t kSteepPasses = 3;
constexpr std::uint32_t kSmoothPasses = 2;

// The arm alone: solver, chain, limits, blending.
constexpr std::uint32_t kPosition = 4400;
constexpr std::uint32_t kPositionPerJoint = 1595;
constexpr std::uint32_t kPose = 9200;
constexpr std::uint32_t kPosePerJoint = 2060;

// Per cycle, independent of the passes.
constexpr std::uint32_t kSensor = 44;
constexpr std::uint32_t kCoupling = 240;
constexpr std::uint32_t kFrame = 300;  // of a virtual joint
constexpr std::uint32_t kPassivePerJoint = 140;
constexpr std::uint32_t kFrameOfPose = 540;

// Per pass.
constexpr std::uint32_t kStillState = 15;
constexpr std::uint32_t kPositionState = 44;
constexpr std::uint32_t kGravityState = 46;
constexpr std::uint32_t kGravity = 60;  // in the frames of the links
constexpr std::uint32_t kGravityPerJoint = 50;
constexpr std::uint32_t kMassSet = 90;
constexpr std::uint32_t kMassSetPerJoint = 80;
constexpr std::uint32_t kTorqueOfCoupling = 44;
constexpr std::uint32_t kOtherCoupling = 9;
constexpr std::uint32_t kTerm = 22;
constexpr std::uint32_t kHarmonic = 62;
constexpr std::uint32_t kSlowWave = 42;

// A grid of one axis and one output (kLine), and the general case.
constexpr std::uint32_t kLine = 115;
constexpr std::uint32_t kGrid = 72;
constexpr std::uint32_t kGridAxis = 76;
constexpr std::uint32_t kGridCorner = 27;
constexpr std::uint32_t kGridOutput = 20;
constexpr std::uint32_t kGridOutputCorner = 8;
constexpr std::uint32_t kListedAxis = 14;
constexpr std::uint32_t kHalving = 11;

// Per evaluation, by kind of node; a grid is counted by its data.
constexpr std::uint32_t kNode[format::kNodeKinds] = {
    10,   // kContinuation
    60,   // kHarmonic
    40,   // kAngle
    38,   // kToAngle
    46,   // kSine
    20,   // kProduct
    90,   // kSum
    60,   // kScale
    102,  // kReciprocal
    22,   // kAbsolute
    26,   // kSign
    22,   // kMinimum
    22,   // kMaximum
    130,  // kSpline
    0,    // kGrid
    108,  // kPowerOfTwo
};

class Counter {
 public:
  explicit Counter(std::span<const std::uint8_t> image) : table_(image) {}

  std::uint32_t count() const { return arm() + states() + gravity() + nodes() + terms(); }

 private:
  const SectionView& section(Section kind) const { return table_.section(kind); }
  std::uint32_t joints() const { return table_.joint_count(); }

  std::uint32_t arm() const;
  std::uint32_t states() const;
  std::uint32_t gravity() const;
  std::uint32_t gravity_passes() const;
  std::uint32_t nodes() const;
  std::uint32_t grid(const std::uint8_t* node) const;
  std::uint32_t terms() const;

  TableView table_;
};

std::uint32_t Counter::arm() const {
  const bool is_full_pose = table_.is_full_pose();
  const std::uint32_t fixed =
      is_full_pose ? kPose + joints() * kPosePerJoint : kPosition + joints() * kPositionPerJoint;
  std::uint32_t moving = 0;  // virtual joints that some record acts on
  for (std::size_t frame = 0; frame < format::kFrames; ++frame) {
    moving += table_.has_motion(frame) ? 1U : 0U;
  }
  return fixed + section(Section::kSensors).count * kSensor +
         section(Section::kCoupling).count * kCoupling +
         (table_.passive() == 0U ? 0U : joints() * kPassivePerJoint) +
         moving * (is_full_pose ? kFrameOfPose : kFrame);
}

std::uint32_t Counter::states() const {
  std::uint32_t sum = 0;
  const SectionView& states = section(Section::kState);
  for (std::size_t i = 0; i < states.count; ++i) {
    const auto kind = static_cast<format::State>(states.begin[i * format::state::kLength]);
    const int kind_class = format::class_of(kind);
    if (kind_class == format::kStillClass) {
      sum += kStillState;
    } else if (kind_class == format::kPositionClass) {
      sum += kSteepPasses * kPositionState;
    } else {
      sum += gravity_passes() * kGravityState;
    }
  }
  return sum;
}

// Gravity is evaluated at the target and, if loads act at the command, again at q₁.
std::uint32_t Counter::gravity_passes() const { return table_.do_loads_act_at_command() ? 2U : 1U; }

// Each change of the mass set from one variable to the next sums all masses again; the torque of a
// motor goes through all couplings.
std::uint32_t Counter::gravity() const {
  std::array<std::uint32_t, kMaxJoints> driven = {};
  const SectionView& coupling = section(Section::kCoupling);
  for (std::size_t i = 0; i < coupling.count; ++i) {
    ++driven[coupling.begin[i * format::coupling::kLength + format::coupling::kColumnAt]];
  }
  std::uint32_t sum = 0;
  std::uint32_t set = format::node::kNone;
  const SectionView& states = section(Section::kState);
  for (std::size_t i = 0; i < states.count; ++i) {
    const std::uint8_t* state = states.begin + i * format::state::kLength;
    const auto kind = static_cast<format::State>(state[format::state::kKindAt]);
    if (format::class_of(kind) != format::kGravityClass) continue;
    sum += set == format::node::kNone ? kGravity + joints() * kGravityPerJoint : 0U;
    sum += set != state[format::state::kSetAt] ? kMassSet + joints() * kMassSetPerJoint : 0U;
    set = state[format::state::kSetAt];
    if (kind == format::State::kTorque) {
      sum += driven[state[format::state::kIndexAt]] * kTorqueOfCoupling +
             coupling.count * kOtherCoupling;
    }
  }
  return gravity_passes() * sum;
}

std::uint32_t Counter::nodes() const {
  const std::uint32_t constant = table_.constant_counts().nodes;
  const std::uint32_t steep = table_.steep_counts().nodes;
  const SectionView& nodes = section(Section::kNodes);
  std::uint32_t sum = 0;
  for (std::uint32_t i = 0; i < nodes.count; ++i) {
    const std::uint8_t* node = nodes.begin + i * format::node::kLength;
    const std::uint8_t kind = node[format::node::kKindAt];
    const bool is_grid = static_cast<format::Node>(kind) == format::Node::kGrid;
    const std::uint32_t once = is_grid ? grid(node) : kNode[kind];
    const std::uint32_t smooth_or_steep = i < steep ? kSteepPasses : kSmoothPasses;
    sum += (i < constant ? kConstantPasses : smooth_or_steep) * once;
  }
  return sum;
}

std::uint32_t Counter::grid(const std::uint8_t* node) const {
  const std::uint8_t* data = section(Section::kData).begin +
                             4 * static_cast<std::size_t>(load_i32(node + format::node::kRAt));
  const std::uint32_t axes = data[format::grid::kAxesAt];
  const std::uint32_t outputs = data[format::grid::kOutputsAt];
  const std::uint32_t corners = 1U << axes;
  std::uint32_t sum = axes == 1U && outputs == 1U
                          ? kLine
                          : kGrid + axes * kGridAxis + corners * kGridCorner +
                                outputs * (kGridOutput + corners * kGridOutputCorner);
  const std::uint8_t* axis = data + format::grid::kHeadLength;
  for (std::uint32_t i = 0; i < axes; ++i) {
    const std::uint32_t count = load_u16(axis + format::grid::kAxisNodesAt);
    const bool is_listed = (axis[format::grid::kAxisFlagsAt] & format::grid::kAxisExplicit) != 0U;
    if (is_listed) {
      sum += kListedAxis + static_cast<std::uint32_t>(std::bit_width(count - 1U)) * kHalving;
    }
    axis += format::grid::kAxisHeadLength + format::grid::axis_length(count, is_listed);
  }
  return sum;
}

std::uint32_t Counter::terms() const {
  const auto weighed = [](std::uint32_t constant, std::uint32_t steep, std::uint32_t all) {
    return constant * kConstantPasses + (steep - constant) * kSteepPasses +
           (all - steep) * kSmoothPasses;
  };
  const TermCounts& steep = table_.steep_counts();
  return kTerm *
             weighed(table_.constant_counts().terms, steep.terms, section(Section::kTerms).count) +
         kHarmonic * weighed(0, steep.harmonics, section(Section::kHarmonics).count) +
         kSlowWave * kSmoothPasses * section(Section::kSlowWaves).count;
}

}  // namespace

std::uint32_t cycle_cost(std::span<const std::uint8_t> image) { return Counter(image).count(); }

}  // namespace armtrue
