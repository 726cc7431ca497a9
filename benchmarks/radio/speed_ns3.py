"""One measurement of ns-3's lr-wpan, run by the interpreter of an environment with the package ns3.

`python radio_speed_ns3.py SENDERS G OCTETS FRAMES SEED` prints the frames on the air per CPU second of the event
loop. The traffic is C++ as well, compiled by the package's own bindings, so that no Python runs meanwhile.
"""

# ruff: noqa
# mypy: ignore-errors

import sys
import time

from ns import ns

senders, load, octets, frames, seed = (
    kind(word) for kind, word in zip((int, float, int, int, int), sys.argv[1:])
)

ns.cppyy.cppdef(r"""
using namespace ns3;
#include <deque>
namespace bench {
uint64_t begun = 0;
void count(Ptr<const Packet>) { ++begun; }
struct Sender {
  Ptr<lrwpan::LrWpanNetDevice> device; Ptr<ExponentialRandomVariable> wait; int size; int queued = 0; uint8_t handle = 0;
  void hand() {
    lrwpan::McpsDataRequestParams p;
    p.m_srcAddrMode = lrwpan::SHORT_ADDR; p.m_dstAddrMode = lrwpan::SHORT_ADDR; p.m_dstPanId = 0;
    p.m_dstAddr = Mac16Address("ff:ff"); p.m_msduHandle = handle++; p.m_txOptions = 0;
    device->GetMac()->McpsDataRequest(p, Create<Packet>(size));
  }
  void arrive() {
    Simulator::Schedule(Seconds(wait->GetValue()), &Sender::arrive, this);
    if (queued < 8 && queued++ == 0) hand();
  }
  void confirm(lrwpan::McpsDataConfirmParams) { if (--queued > 0) hand(); }
};
std::vector<Sender*> all;
void build(int senders, double load, int octets, uint32_t seed) {
  RngSeedManager::SetSeed(seed);
  Ptr<SingleModelSpectrumChannel> channel = CreateObject<SingleModelSpectrumChannel>();
  Ptr<MatrixPropagationLossModel> loss = CreateObject<MatrixPropagationLossModel>();
  loss->SetDefaultLoss(60.0);
  channel->AddPropagationLossModel(loss);
  double airtime = (12 + 2 * octets) * 16e-6;
  for (int i = 0; i <= senders; ++i) {
    Ptr<Node> node = CreateObject<Node>();
    Ptr<ConstantPositionMobilityModel> where = CreateObject<ConstantPositionMobilityModel>();
    node->AggregateObject(where);
    Ptr<lrwpan::LrWpanNetDevice> device = CreateObject<lrwpan::LrWpanNetDevice>();
    device->SetAddress(Mac16Address((uint16_t)(i + 1)));
    device->SetChannel(channel);
    node->AddDevice(device);
    device->GetPhy()->SetMobility(where);
    device->GetPhy()->SetRxSensitivity(-95);
    device->GetPhy()->TraceConnectWithoutContext("PhyTxBegin", MakeCallback(&count));
    Sender* s = new Sender{device, CreateObject<ExponentialRandomVariable>(), octets - 11};
    all.push_back(s);
    if (i == senders) continue;
    s->wait->SetAttribute("Mean", DoubleValue(senders * airtime / load));
    device->GetMac()->SetMcpsDataConfirmCallback(MakeCallback(&Sender::confirm, s));
    Simulator::Schedule(Seconds(s->wait->GetValue()), &Sender::arrive, s);
  }
}
void go(double until) { Simulator::Stop(Seconds(until) - Simulator::Now()); Simulator::Run(); }
}
""")

per_second = load / ((12 + 2 * octets) * 16e-6)
ns.cppyy.gbl.bench.build(senders, load, octets, seed)
ns.cppyy.gbl.bench.go(0.5)
before = ns.cppyy.gbl.bench.begun
started = time.process_time()
ns.cppyy.gbl.bench.go(0.5 + frames / per_second)
spent = time.process_time() - started
print((ns.cppyy.gbl.bench.begun - before) / spent)
