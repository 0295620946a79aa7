"""Bytes on the wire: UDP, TCP, serial, and memory for a virtual clock.

A transport fits `base.Transport`. A new one is a module here, a kind and its form in `swarmctl.links.url`,
and a case in `FrontEnd._transport`.
"""
