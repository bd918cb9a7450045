#include <vector>

#include "simulation/scenario_entry.hpp"

namespace gsv {
namespace {

using Options = SyntheticDrive::Options;
using simulation::Entry;
using simulation::setSmallCamera;

void addImageFaults(std::vector<Scenario>* drives) {
  struct Fault {
    const char *name, *description;
    FaultKind kind;
    std::size_t frames;
    bool hides_road;
  };
  for (const Fault& f : {
           Fault{"fault_white", "white images", FaultKind::kWhite, 40, true},
           Fault{"fault_frozen", "the same image with new stamps", FaultKind::kFrozen, 40, true},
           Fault{"fault_covered", "the lens is covered", FaultKind::kCovered, 40, true},
           Fault{"fault_mud", "mud on two thirds of the lens", FaultKind::kCoveredBelow, 40, true},
           Fault{"fault_mud_left", "mud on half of the lens", FaultKind::kCoveredLeft, 25, false},
           Fault{"fault_rain", "rain, and drops on the lens", FaultKind::kRain, 25, false},
           Fault{"fault_darker", "an exposure of 40 %", FaultKind::kDarker, 20, false},
           Fault{"fault_brighter", "an exposure of 250 %", FaultKind::kBrighter, 20, false},
           Fault{"fault_flicker", "an exposure that varies", FaultKind::kFlicker, 20, false},
       }) {
    constexpr std::size_t kFirst = 45, kAfter = 60;
    Entry drive(f.name, f.description, static_cast<int>(kFirst + f.frames + kAfter),
                [](Options& o) { setSmallCamera(o), o.speed = 8, o.curvature = 0; });
    drive.imageFault(f.kind, kFirst, f.frames);
    // Known limitation: a frozen image is a standstill, in which the scale seems to be known.
    if (f.kind == FaultKind::kFrozen) {
      drive.threshold(&ScenarioThresholds::min_within_2_sigma, 0.65);
    }
    drives->push_back(f.hides_road ? drive.hidesTheRoad() : drive);
  }
}

}  // namespace

std::vector<Scenario> faultScenarios() {
  std::vector<Scenario> drives = {
      Entry("fault_lorry", "a lorry drives close ahead for ten seconds and hides the road", 225,
            [](Options& o) {
              setSmallCamera(o);
              o.speed = 8;
              o.curvature = 0;
              o.lorry = {45, 164};
            })
          .fault({45, 154})  // until it starts to leave the lane
          .hidesTheRoad(),
      Entry("fault_wall", "drives up to a wall, stops and reverses", 220,
            [](Options& o) {
              setSmallCamera(o);
              o.random_seed = 2;  // with every second seed a new map starts, 2 m off
              o.speed = 8;
              o.speeds = {{0, 8}, {4.5, 8}, {7, 0}, {9, 0}, {10, -3}};
              o.wall_at_m = 47.8;
              o.curvature = o.slope = 0;
              o.moving_cars = false;
            })
          .fault({51, 106})  // the wall fills the image
          .hidesTheRoad(),
  };
  addImageFaults(&drives);
  return drives;
}

}  // namespace gsv
