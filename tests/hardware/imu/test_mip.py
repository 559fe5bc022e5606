import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.imu.mip import Field, Packet, PacketReader, checksum, encode_packet

PRINTED = {
    # As printed in the manufacturer's manuals of the 3DM-CV7 (the first) and the 3DM-GX5.
    "75 65 80 0E 0E 04 3E 7A 63 A0 BB 8E 3B 29 7F E5 BF 7F 84 EE": Packet(
        0x80, (Field(0x04, bytes.fromhex("3E7A63A0BB8E3B297FE5BF7F")),)
    ),
    "75 65 01 02 02 06 E5 CB": Packet(0x01, (Field(0x06, b""),)),
    "75 65 0C 02 02 07 F1 F8": Packet(0x0C, (Field(0x07, b""),)),
    "75 65 0C 05 05 11 01 01 01 04 1A": Packet(0x0C, (Field(0x11, b"\x01\x01\x01"),)),
    "75 65 0C 05 05 11 01 01 00 03 19": Packet(0x0C, (Field(0x11, b"\x01\x01\x00"),)),
    "75 65 01 04 04 F1 06 00 DA 74": Packet(0x01, (Field(0xF1, b"\x06\x00"),)),
}


@pytest.mark.parametrize(("text", "packet"), PRINTED.items())
def test_the_manuals_examples(text, packet):
    data = bytes.fromhex(text)
    assert encode_packet(packet.descriptor_set, packet.fields) == data
    reader = PacketReader()
    assert list(reader.feed(data)) == [packet]
    assert (reader.damaged, reader.skipped) == (0, 0)


fields = st.lists(st.builds(Field, st.integers(0, 255), st.binary(max_size=20)), max_size=8).map(tuple)
packets = st.builds(Packet, st.integers(0, 255), fields)


@given(st.lists(packets, max_size=5), st.lists(st.integers(1, 30), min_size=1))
def test_packets_come_out_as_they_went_in_however_the_stream_is_cut(sent, cuts):
    stream = b"".join(encode_packet(packet.descriptor_set, packet.fields) for packet in sent)
    reader, found, i = PacketReader(), [], 0
    while stream:
        size = cuts[i % len(cuts)]
        found += reader.feed(stream[:size])
        stream, i = stream[size:], i + 1
    assert found == sent
    assert (reader.damaged, reader.skipped) == (0, 0)


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_noise_never_raises_and_never_passes_for_a_packet_with_a_wrong_checksum(pieces):
    reader = PacketReader()
    found = [packet for piece in pieces for packet in reader.feed(piece)]
    stream = b"".join(pieces)
    for packet in found:
        assert encode_packet(packet.descriptor_set, packet.fields) in stream


def test_a_damaged_packet_costs_no_other():
    good = encode_packet(0x80, [Field(0x04, bytes(12))])
    reader = PacketReader()
    changed = good[:8] + b"\xff" + good[9:]
    assert len(list(reader.feed(good + changed + good))) == 2
    assert reader.damaged == 1
    cut = good[:10] + good[11:]  # a byte is lost: the length now reaches into the next packet
    assert len(list(reader.feed(cut + good))) == 1
    assert reader.damaged == 2


def test_a_checksum_that_is_right_does_not_excuse_fields_that_do_not_fill_the_packet():
    for payload in (b"\x00\x04", b"\x01\x04", b"\x09\x04\x00"):
        packet = b"ue\x80" + bytes((len(payload),)) + payload
        reader = PacketReader()
        assert list(reader.feed(packet + checksum(packet))) == []
        assert reader.damaged == 1


def test_a_payload_that_its_length_cannot_say_is_refused():
    with pytest.raises(ValueError, match="range"):
        encode_packet(0x80, [Field(0x04, bytes(200)), Field(0x05, bytes(200))])
