// All options of the method, by part.
#pragma once

#include "idol/backend/backend_options.hpp"
#include "idol/base/options.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol {

struct EventFilterOptions {
  bool flicker = true;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("flicker", self.flicker, Range{},
          "leave out the events of lamps that flicker at 86 to 134 Hz, which is twice the mains' frequency");
  }
};

struct PipelineOptions {
  int threads = 2;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("threads", self.threads, Range{1, 2},
          "2: the back-end works in a thread of its own while the front-end goes on; results are the same");
  }
};

struct Options {
  EventFilterOptions filter;
  WindowOptions window;
  SegmentOptions segment;
  PreintegrationOptions imu;
  ImuInitOptions start;
  BackendOptions backend;
  PipelineOptions pipeline;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("filter", self.filter, Range{}, "");
    visit("window", self.window, Range{}, "");
    visit("segment", self.segment, Range{}, "");
    visit("imu", self.imu, Range{}, "");
    visit("start", self.start, Range{}, "");
    visit("backend", self.backend, Range{}, "");
    visit("pipeline", self.pipeline, Range{}, "");
  }
};

}  // namespace idol
